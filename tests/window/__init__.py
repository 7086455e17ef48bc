"""The window, the session behind it and what both draw."""
