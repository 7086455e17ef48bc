"""The first frame and every next one: photons taken in, light of the static part and of mobiles."""
