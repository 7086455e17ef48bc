"""Reflection models, one per file. `lambertian` is the only one: faces are diffuse.

Contract of a model, as kernels. Directions are unit vectors in the local frame of the reflecting side, z along its
normal; `cos_out` is the z of the direction of flight after reflection. rho is reflectance per channel, in [0, 1).

- `sample(u, v)`: a direction (x, y, z) from two numbers in [0, 1). Every sample is valid: z >= 0.
- `pdf(cos_out)`: the density [1/sr] of `sample`; 0 below the surface.
- `weight(rho)`: f cos / pdf of a sampled direction for one channel, cosine included; 0 absorbs. Photons and paths
  multiply what they carry by it, so no caller evaluates f alone.

Callers: `photons.trace` and `gather.path_tracer` (`sample`, `weight`), `gather.shared_samples` (`sample`),
`lights.next_event` (`pdf`). Receivers keep irradiance E, from which `geometry.radiosity` reads rho E / pi. A model
whose f depends on direction needs another record than E, there and in `gather.one_bounce`, which reads E at hits.
"""
