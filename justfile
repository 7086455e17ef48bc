# Tasks: `.venv/bin/just` lists them. `setup` needs no root; every other task needs `setup` once.
python := if os_family() == "windows" { ".venv/Scripts/python" } else { ".venv/bin/python" }

# List the tasks
default:
    @just --list

# Create .venv with the program, its tests and these tasks
setup:
    python3 -m venv .venv
    {{python}} -m pip install --quiet --editable ".[dev]"

# Unit tests: under a minute on two cores once kernels are compiled
quick *options:
    {{python}} -m pytest -m "not slow and not gl" tests/unit {{options}}

# All tests
test *options:
    {{python}} -m pytest {{options}}

# Tests of the physics where embreex cannot be imported: rays are traced by bvh
without-embreex *options:
    GI_EVERY_STRUCTURE=1 PYTHONPATH={{justfile_directory()}}/tests/support/no_embreex {{python}} -m pytest tests/physics tests/unit/rays {{options}}

# Style, package order and types, as CI checks them
lint:
    {{python}} -m ruff check .
    {{python}} -m ruff format --check .
    {{python}} -c "import sys; from importlinter.cli import lint_imports; sys.exit(lint_imports())"
    {{python}} -m mypy
    {{python}} -m studies.ratchet

# API reference of the public packages, in out/api
docs:
    {{python}} -m pdoc --docformat google --output-directory out/api gi_core.solver gi_core.scene gi_core.files gi_core.estimators gi_core.gather.reference

# Frame times of twelve cases, appended to bench/history.csv and drawn beside it
bench:
    {{python}} -m studies.frame_history

# A window driven at random for MINUTES, on empty stores
soak minutes="5" scene="cornell":
    {{python}} -m studies.soak --minutes {{minutes}} --scene {{scene}} --fresh
