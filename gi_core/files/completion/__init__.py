"""Camera, lights, mobiles and mesh density for files that name none."""
