"""Experiments on semantic planners that anyone can repeat: finished cells are kept, pages are made of them."""
