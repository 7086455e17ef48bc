"""Estimators of irradiance from segments, of identical shape. A new one adds its line here.

Each has, in the order of use: `build()`, steps to run once; `add_background(segments, photons)`;
`prepare()`, steps after which `photons` covers all added; `evaluate(frame) -> (sums, area)`, with
`reach` [m], how far from a receiver on a mobile it looks for segments; and, to check against,
`from_scratch(parts, at) -> (sums, area)`. Irradiance is sums x flux unit / (photons x area).
"""

from gi_core.estimators.impact_count import ImpactCount
from gi_core.estimators.photon_map import PhotonMap
from gi_core.estimators.tangent_plane import TangentPlane

ESTIMATORS = {"tangent_plane": TangentPlane, "photon_map": PhotonMap, "impact_count": ImpactCount}
