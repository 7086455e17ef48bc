"""Drawing: vertex colours, OpenGL, ray casting, tone map, camera, paths of mobiles."""
