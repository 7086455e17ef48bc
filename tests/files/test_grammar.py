"""Files written by grammar load, or are refused in one sentence that names the file; `studies/grammar.py` runs more."""

from __future__ import annotations

import os

import pytest

from gi_core.files.load import load_scene
from gi_core.scene import SceneError
from gi_core.scene.errors import SENTENCE
from tests.support.grammar.cases import KINDS, case, write


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="this system has no named pipes")
@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("kind", range(len(KINDS)), ids=KINDS)
def test_files_by_grammar(tmp_path, kind):
    for seed in range(kind, 24 * len(KINDS), len(KINDS)):
        path = write(tmp_path / str(seed), seed)
        try:
            load_scene(path, max_edge=float("inf"))
        except SceneError as error:
            text = str(error)
            assert path.name in text and text.isprintable() and len(text) <= SENTENCE, seed
            # A valid file loads.
            assert case(seed)[2] > 0, text
