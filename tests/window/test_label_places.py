"""Places of labels: inside the picture, over nothing that is taken."""

import numpy as np

from app.window.label import SLACK, LabelPlaces

AREA = (0.0, 0.0, 300.0, 200.0)


def overlap(a, b) -> bool:
    return min(min(a[2], b[2]) - max(a[0], b[0]), min(a[3], b[3]) - max(a[1], b[1])) > 2 * SLACK


def test_a_label_stands_right_of_its_point_where_there_is_room():
    places = LabelPlaces(AREA)
    assert places.take(places.beside((100, 100), (60, 20), 5)) == (105, 90, 165, 110)
    assert places.take(places.beside((290, 100), (60, 20), 5)) == (225, 90, 285, 110), "left of it at the right edge"
    assert places.take(places.beside((100, 5), (60, 20), 5))[1] >= 0, "below it at the top"


def test_labels_overlap_neither_each_other_nor_the_legend():
    legend = (180.0, 20.0, 290.0, 190.0)
    rng = np.random.default_rng(0)
    for _ in range(50):
        places = LabelPlaces(AREA, [legend])
        points = rng.uniform((0, 0), (300, 200), (12, 2)).tolist()
        boxes = [legend, *(b for at in points if (b := places.take(places.beside(tuple(at), (70, 18), 6))) is not None)]
        assert len(boxes) > 5
        assert not [(a, b) for k, a in enumerate(boxes) for b in boxes[:k] if overlap(a, b)]
        assert all(b[0] >= 0 and b[1] >= 0 and b[2] <= 300 and b[3] <= 200 for b in boxes)


def test_a_label_without_room_has_no_place():
    places = LabelPlaces(AREA, [AREA])
    assert places.take(places.beside((100, 100), (60, 20), 5)) is None
