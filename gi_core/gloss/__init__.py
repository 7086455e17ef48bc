"""Gloss at receivers: the directions from which light arrives, and the radiance that glossy faces send to an eye."""
