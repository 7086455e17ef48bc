"""A pose: the photons whose paths mobiles cut, the parts removed, the parts added."""
