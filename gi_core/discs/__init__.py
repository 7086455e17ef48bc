"""Discs of receivers: their visible region, and the segments that cross them."""
