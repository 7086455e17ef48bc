"""Programs that measure for minutes or hours: `python -m studies.NAME --help`."""
