# Tasks of those who work on roadscope; `just` lists them (https://just.systems).
# Tools of another environment: `just bin=/path/to/bin lint`.

bin := ".venv/bin"

# List the tasks
default:
    @just --list

# Make the virtual environment and install the commit hooks
setup:
    python3 -m venv .venv
    .venv/bin/pip install -c constraints.txt -e ".[test,lint,docs]"
    .venv/bin/pre-commit install

# Run the quick tests
test *arguments:
    {{bin}}/python -m pytest {{arguments}}

# Run one test file, or one test, in one process
one path *arguments:
    {{bin}}/python -m pytest -n 0 {{path}} {{arguments}}

# Run the heavier tests
slow *arguments:
    {{bin}}/python -m pytest -m slow {{arguments}}

# Format the code and fix what can be fixed
format:
    {{bin}}/ruff check --fix .
    {{bin}}/ruff format .

# Check the code with ruff
lint:
    {{bin}}/ruff check .
    {{bin}}/ruff format --check .

# Check the types
types:
    {{bin}}/mypy

# Check which package may import which
imports:
    {{bin}}/lint-imports

# Check lint, types and import rules
check: lint imports types

# Write the list of public names again
names:
    {{bin}}/python tests/test_public_face.py

# Build the site into build/site; what is wrong with it stops the build
docs:
    {{bin}}/sphinx-build --quiet --fail-on-warning --keep-going docs build/site

# Build the wheel and the source distribution into dist/
build:
    {{bin}}/python -m pip install --quiet build twine
    {{bin}}/python -m build
    {{bin}}/python -m twine check --strict dist/*

# Run everything that CI runs
ci:
    .ci/run
