"""The command line, its commands, the package and the documentation."""
