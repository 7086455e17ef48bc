"""Files and scenes: formats, completion, shipped scenes, hostile input."""
