"""In place of embreex where PYTHONPATH begins with the folder above: a platform without wheels of it."""

raise ImportError("No module named 'embreex'")
