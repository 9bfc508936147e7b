"""A user's own pictures: taken from any source, labelled in a browser, exchanged as COCO."""
