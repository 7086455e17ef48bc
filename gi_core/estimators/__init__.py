"""Estimators of irradiance from segments, of identical shape. A new one adds its line here.

Each has, in the order of use: `build()`, steps to run once; `add_background(segments, thread)`;
`prepare(photons)`, steps after which `prefixes` has all that was added, the first `photons`;
`evaluate(frame) -> Evaluated` for a frame of one of the prefixes, with `reach` [m], how far from a
receiver on a mobile it looks for segments; and, to check against, `from_scratch(parts, at) ->
Evaluated`. Irradiance is sums x flux unit / (photons x area). `additive`: prepare() costs next to nothing;
`bytes_a_hit`: memory that it keeps.
"""

from gi_core.estimators.impact_count import ImpactCount
from gi_core.estimators.photon_map import PhotonMap
from gi_core.estimators.tangent_plane import TangentPlane

ESTIMATORS = {"tangent_plane": TangentPlane, "photon_map": PhotonMap, "impact_count": ImpactCount}
