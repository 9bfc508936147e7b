"""Where the cameras really are and how their lenses bend, from images of the bracket's plate, whose place is known."""
