"""The only room that reads what really is: labels, contacts, score."""
