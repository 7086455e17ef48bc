"""Estimators of irradiance from segments, of identical shape. A new one adds its line here.

Each has `reach` [m] (how far from a receiver it looks), `add_background(segments)`,
`evaluate(frame) -> (sums, area)`, `from_scratch(parts, at) -> (sums, area)`; irradiance is
sums x flux unit / (photons x area).
"""

from gi_core.estimators.impact_count import ImpactCount
from gi_core.estimators.tangent_plane import TangentPlane

ESTIMATORS = {"tangent_plane": TangentPlane, "impact_count": ImpactCount}
