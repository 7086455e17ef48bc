"""The command line's parts: parser, values, option groups, progress, folders that can be written."""
