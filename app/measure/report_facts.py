"""What the report's tables 2.1 to 2.5 say: seconds on a computer of 2003. Facts, typed in."""

RAY_CACHE, DISC_INDEX = "ray_cache", "disc_index"

# Table 2.1: simulation, illumination, total [s], error.
ESTIMATORS = {"tangent_plane": (50_000, 0.05, 0.80, 0.85, 16.10), "impact_count": (1_000_000, 1.09, 0.02, 1.11, 139.54)}

# Tables 2.2 to 2.4 a): a frame's seconds by radius, of receivers "whole", "tree" or "ground".
TREE_RADII = (0.01, 0.02, 0.03, 0.04)
TREE_10000 = {
    ("whole", RAY_CACHE): (4.45, 5.70, 7.32, 9.24),
    ("whole", DISC_INDEX): (1.46, 3.43, 7.18, 17.79),
    ("tree", RAY_CACHE): (4.03, 5.34, 6.78, 8.38),
    ("tree", DISC_INDEX): (0.89, 2.78, 7.15, 18.37),
    ("ground", RAY_CACHE): (0.39, 0.46, 0.62, 0.74),
    ("ground", DISC_INDEX): (0.21, 0.33, 0.50, 0.68),
}
TREE_20000 = {("whole", RAY_CACHE): (5.50, 8.16, 11.38, 15.89), ("whole", DISC_INDEX): (2.89, 6.82, 14.12, 41.95)}
SECOND_RADII = (0.03, 0.04, 0.05, 0.10)
SECOND_20000 = {("whole", RAY_CACHE): (2.28, 2.86, 3.79, 7.83), ("whole", DISC_INDEX): (1.34, 2.17, 3.22, 10.29)}

# The same tables b): the number of primitives a voxel that was best. Table 2.4's columns are named as 2.2's are.
VOXELS_10000 = {"whole": (20, 20, 50, 800), "tree": (20, 10, 100, 1600), "ground": (20, 80, 120, 160)}
VOXELS_20000 = {"whole": (20, 20, 200, 1600)}
VOXELS_SECOND = {"whole": (40, 80, 160, 32000)}

# Table 2.5: simulation and illumination [s], at the start and of a frame.
PRETESTS = {
    "badouel": (10.34, 679.44, 1.02, 67.90),
    "moeller_trumbore": (10.29, 666.34, 0.98, 67.27),
    "pluecker": (10.40, 716.47, 1.05, 68.66),
    "none": (10.38, 678.75, 1.05, 68.00),
}
