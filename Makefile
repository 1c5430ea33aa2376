# `make test` and `make demo` set up .venv by themselves, once.
PYTHON ?= python3
VENV ?= .venv
# Others may point pip at PyTorch's own CPU wheels: make demo TORCH_INDEX=https://download.pytorch.org/whl/cpu
TORCH_INDEX ?=
BIN := $(VENV)/bin
# without its dependencies, of which that index may lack the pinned versions: the next line installs them
PIP_TORCH := $(if $(TORCH_INDEX),--no-deps --index-url $(TORCH_INDEX),)
TEST_WORKERS ?= 2

.PHONY: install test quick hostile planted lint types demo bench wheel docs clean

install: $(VENV)/.installed

$(VENV)/.installed: pyproject.toml constraints.txt
	$(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet $(PIP_TORCH) -c constraints.txt torch
	$(BIN)/python -m pip install --quiet -c constraints.txt -e '.[dev,train,rl]'
	touch $@

# one thread a worker: more of them wait for each other
test quick hostile: export OMP_NUM_THREADS = 1
# Empty: each of the many processes of the tests would compile the sources, and pytest all tests, where it is set.
test quick hostile: export PYTHONDONTWRITEBYTECODE =

# A worker takes whole files, in the order of tests/conftest.py.
test: install
	$(BIN)/python -m pytest -n $(TEST_WORKERS) --dist loadfile --no-loadscope-reorder -m "not benchmark"

# Checks the whole chain in a minute.
quick: install
	$(BIN)/python -m pytest -n $(TEST_WORKERS) --dist loadfile --no-loadscope-reorder -m "quick and not benchmark"

# Many more cases of the attacks in tests/hostile, of which `make test` runs a few.
# Attacks on processes stop when their shares of HOSTILE_MINUTES are over; too few cases are a failure.
# Another HOSTILE_SEED gives other cases.
HOSTILE_CASES ?= 300
HOSTILE_MINUTES ?= 30
HOSTILE_SEED ?= 0
hostile: export HOSTILE_CASES := $(HOSTILE_CASES)
hostile: export HOSTILE_MINUTES := $(HOSTILE_MINUTES)
hostile: export HOSTILE_SEED := $(HOSTILE_SEED)
hostile: install
	$(BIN)/python -m pytest tests/hostile -n $(TEST_WORKERS) --dist worksteal

# Plant a defect of each kind of attack in a copy, and check that the campaign finds it.
planted: install
	$(BIN)/python tests/hostile/planted.py

lint: install
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/lint-imports

types: install
	$(BIN)/mypy

demo: install
	$(BIN)/python -m envs.demo --out out/demo

# With as many threads as cores, where the tests have one.
bench: export OMP_NUM_THREADS := $(or $(OMP_NUM_THREADS),$(shell getconf _NPROCESSORS_ONLN))
bench: install
	$(BIN)/python -m pytest tests/benchmarks -m benchmark -s

# Setuptools would take modules that were deleted since the last build from build/.
wheel: install
	rm -rf build
	$(BIN)/python -m build --wheel --outdir dist .

# The site, in site/: strict, and without the network once it is installed.
docs: install $(VENV)/.docs
	NO_MKDOCS_2_WARNING=1 $(BIN)/python -m mkdocs build --strict

$(VENV)/.docs: pyproject.toml constraints.txt
	$(BIN)/python -m pip install --quiet -c constraints.txt -e '.[docs]'
	touch $@

clean:
	rm -rf $(VENV) build dist site out *.egg-info
