"""Scene files by grammar, one per seed: TOML 1.0, OBJ and MTL, PLY 1.0, glTF 2.0, and the images that they name.

Every production follows the public specification of its format or `docs/scene-format.md`, not the loaders. `oddity` is
the share of leaves that keep the syntax but leave the meaning: another type, an extreme number, an index out of range,
a list too short. A document of oddity 0 is valid.
"""
