"""Rays against triangles: the nearest hit, any hit, first the static part and then mobiles."""
