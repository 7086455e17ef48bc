"""The command line's parts: parser, value types, option groups, progress bar, write checks."""
