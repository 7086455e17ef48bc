"""Estimators of irradiance. A new one is one file that follows `base.Estimator`, and one line here."""

from gi_core.estimators.base import Estimator
from gi_core.estimators.impact_count import ImpactCount
from gi_core.estimators.photon_map import PhotonMap
from gi_core.estimators.tangent_plane import TangentPlane

ESTIMATORS: dict[str, type[Estimator]] = {
    "tangent_plane": TangentPlane,
    "photon_map": PhotonMap,
    "impact_count": ImpactCount,
}
DEFAULT = "tangent_plane"  # if none is chosen
CHEAPEST = "impact_count"  # builds and keeps nothing: for uses that need photons alone
