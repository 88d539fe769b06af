"""The acceleration that given efforts cause at one instant, and whether friction holds."""
