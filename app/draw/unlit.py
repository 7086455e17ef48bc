"""Display colours of pixels without light, alike in ray casting and OpenGL."""

from __future__ import annotations

BACKGROUND = (0.145, 0.15, 0.16)  # lighter than a black patch
UNLIT = (0.24, 0.245, 0.255)  # the back of a one-sided face, without culling
