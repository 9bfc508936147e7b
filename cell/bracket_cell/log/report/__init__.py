"""Shows what a log says: texts, pages, pictures, exports."""
