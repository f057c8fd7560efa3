"""Applications: each folder has its objects, its command and its page."""
