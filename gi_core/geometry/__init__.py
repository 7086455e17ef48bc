"""Surfaces as flat arrays: receivers, textures, tessellation, measures of error over them."""
