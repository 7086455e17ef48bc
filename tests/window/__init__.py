"""The window, its session, and their drawing."""
