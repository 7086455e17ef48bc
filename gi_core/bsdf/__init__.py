"""Reflection of light at faces: diffuse by `lambertian`, with gloss by `ggx` or a `table`.

Kernels ask the queries of `surface`: is_glossy() and tangent_of() of a face, scattered() for a photon, and value(),
pdf() and sampled() for a path. The type of a scene's faces chooses their code. Kernels call `lambertian` where
is_glossy() is False.
"""
