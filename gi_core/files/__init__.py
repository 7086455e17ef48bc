"""A scene file, a mesh file or a shipped name becomes a complete Scene."""
