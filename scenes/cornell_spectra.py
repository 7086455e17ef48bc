"""The measured spectra of the Cornell box, and their conversion to linear Rec. 709.

Source: Cornell University Program of Computer Graphics, measured Cornell box data (as distributed with
Mitsuba, scene bsdf_twosided_cbox.xml).

Radiance and reflectance become RGB through the CIE 1931 2-degree observer, in the analytic fit of Wyman,
Sloan and Shirley 2013 ("Simple analytic approximations to the CIE XYZ color matching functions").
A reflectance is that seen under this lamp, not under an equal-energy light: rho_c = RGB_c(L rho) / RGB_c(L),
so that lamp x wall has the colour of the spectral product, exactly at the first bounce; and grey stays
grey. Primaries that cannot show a saturated wall would make a channel negative: it is cut off at 0.
"""

from __future__ import annotations

import numpy as np

WAVELENGTHS = np.arange(400.0, 701.0, 4.0)  # [nm]
# fmt: off
WHITE = (
    0.343, 0.445, 0.551, 0.624, 0.665, 0.687, 0.708, 0.723, 0.715, 0.71, 0.745, 0.758, 0.739, 0.767, 0.777,
    0.765, 0.751, 0.745, 0.748, 0.729, 0.745, 0.757, 0.753, 0.75, 0.746, 0.747, 0.735, 0.732, 0.739, 0.734,
    0.725, 0.721, 0.733, 0.725, 0.732, 0.743, 0.744, 0.748, 0.728, 0.716, 0.733, 0.726, 0.713, 0.74, 0.754,
    0.764, 0.752, 0.736, 0.734, 0.741, 0.74, 0.732, 0.745, 0.755, 0.751, 0.744, 0.731, 0.733, 0.744, 0.731,
    0.712, 0.708, 0.729, 0.73, 0.727, 0.707, 0.703, 0.729, 0.75, 0.76, 0.751, 0.739, 0.724, 0.73, 0.74,
    0.737,
)
RED = (
    0.04, 0.046, 0.048, 0.053, 0.049, 0.05, 0.053, 0.055, 0.057, 0.056, 0.059, 0.057, 0.061, 0.061, 0.06,
    0.062, 0.062, 0.062, 0.061, 0.062, 0.06, 0.059, 0.057, 0.058, 0.058, 0.058, 0.056, 0.055, 0.056, 0.059,
    0.057, 0.055, 0.059, 0.059, 0.058, 0.059, 0.061, 0.061, 0.063, 0.063, 0.067, 0.068, 0.072, 0.08, 0.09,
    0.099, 0.124, 0.154, 0.192, 0.255, 0.287, 0.349, 0.402, 0.443, 0.487, 0.513, 0.558, 0.584, 0.62, 0.606,
    0.609, 0.651, 0.612, 0.61, 0.65, 0.638, 0.627, 0.62, 0.63, 0.628, 0.642, 0.639, 0.657, 0.639, 0.635,
    0.642,
)
GREEN = (
    0.092, 0.096, 0.098, 0.097, 0.098, 0.095, 0.095, 0.097, 0.095, 0.094, 0.097, 0.098, 0.096, 0.101, 0.103,
    0.104, 0.107, 0.109, 0.112, 0.115, 0.125, 0.14, 0.16, 0.187, 0.229, 0.285, 0.343, 0.39, 0.435, 0.464,
    0.472, 0.476, 0.481, 0.462, 0.447, 0.441, 0.426, 0.406, 0.373, 0.347, 0.337, 0.314, 0.285, 0.277, 0.266,
    0.25, 0.23, 0.207, 0.186, 0.171, 0.16, 0.148, 0.141, 0.136, 0.13, 0.126, 0.123, 0.121, 0.122, 0.119,
    0.114, 0.115, 0.117, 0.117, 0.118, 0.12, 0.122, 0.128, 0.132, 0.139, 0.144, 0.146, 0.15, 0.152, 0.157,
    0.159,
)
# fmt: on
LUMINAIRE_REFLECTANCE = 0.78
LAMP = ((400.0, 0.0), (500.0, 8.0), (600.0, 15.6), (700.0, 18.4))  # [nm], radiance; linear between

XYZ_TO_RGB = np.array(
    [
        [3.2404542, -1.5371385, -0.4985314],
        [-0.9692660, 1.8760108, 0.0415560],
        [0.0556434, -0.2040259, 1.0572252],
    ]
)


def matching_functions(wavelengths: np.ndarray) -> np.ndarray:
    """Return x, y, z (n, 3) of the CIE 1931 observer, fitted by sums of two-sided Gaussians."""
    x = (
        _lobe(wavelengths, 1.056, 599.8, 37.9, 31.0)
        + _lobe(wavelengths, 0.362, 442.0, 16.0, 26.7)
        + _lobe(wavelengths, -0.065, 501.1, 20.4, 26.2)
    )
    y = _lobe(wavelengths, 0.821, 568.8, 46.9, 40.5) + _lobe(wavelengths, 0.286, 530.9, 16.3, 31.1)
    z = _lobe(wavelengths, 1.217, 437.0, 11.8, 36.0) + _lobe(wavelengths, 0.681, 459.0, 26.0, 13.8)
    return np.stack([x, y, z], axis=1)


def to_rgb(spectrum: np.ndarray) -> np.ndarray:
    """Return linear Rec. 709 of a spectrum at WAVELENGTHS; a constant 1 has luminance 1."""
    cmf = matching_functions(WAVELENGTHS)
    XYZ = (np.asarray(spectrum)[:, None] * cmf).sum(axis=0) / cmf[:, 1].sum()
    return XYZ_TO_RGB @ XYZ


def lamp_spectrum() -> np.ndarray:
    """Return the lamp's radiance at WAVELENGTHS."""
    return np.interp(WAVELENGTHS, *np.array(LAMP).T)


def lamp_rgb() -> np.ndarray:
    """Return the lamp's radiance in linear Rec. 709 [W/m2/sr]."""
    return to_rgb(lamp_spectrum())


def reflectance_rgb(reflectance) -> np.ndarray:
    """Return the reflectance of a spectrum under the lamp, each channel in [0, 1)."""
    L = lamp_spectrum()
    return np.clip(to_rgb(L * np.asarray(reflectance)) / to_rgb(L), 0.0, 0.98)


def _lobe(w, height, centre, below, above) -> np.ndarray:
    t = (w - centre) / np.where(w < centre, below, above)
    return height * np.exp(-0.5 * t * t)
