"""Frames: which light is on this wall now, and how wrong is it?

1. Without mobiles: `StaticLight.best`, or the background's photons while that is None. It is an `Estimate`: light per
   lamp, variance, source (radiosity, whole paths, before an edit) and error. `compare()` chooses by error.
2. With mobiles, in motion (`Frame.own`): `frame_irradiance()` changes 1. as the frame's photons differ from the same
   photons without mobiles, less the direct light that mobiles block. Paths that end in this light without bias
   (`ControlledLight.unbiased`) light mobiles.
3. At poses that have rested (`Frame.irradiance`): `PoseLight.replaced()` puts light of paths in place of 2.
4. How wrong: `Solver.deviation` is the standard error of 3. per receiver, by `FrameLight.deviation()`. `LiveError` in
   `app.rest` measures the noise of 2. by fewer photons, and compares 3. with an unbiased reference.
5. Drawn: `Solver.drawn()` fills receivers that light cannot reach. Errors and frames do not see this. `read()` of
   `app.draw.readout` interpolates it at a point of the picture, and takes 4. of the nearest receiver.
"""
