"""Where each method fails: theory, measurement, remedy, one chapter per file."""
