# Two commands need nothing but Python 3.11 and make: `make demo` and `make test`.
PYTHON ?= python3
VENV ?= .venv
BIN := $(VENV)/bin
READY := $(VENV)/.ready
ROUND ?= ../shared/concealed/round-1
FUZZ_S ?= 600
SAY_CODE = case $$code in \
	77) echo "dehyst demo: exit status 77: not judged, this machine was too busy; run it again" >&2;; \
	1) echo "dehyst demo: exit status 1: the error did not fall, or the effect was not named correctly" >&2;; esac

.PHONY: demo first-act test quick long check kernels lint types contracts docs reference interpreters release concealed proof fuzz mutate clean

# recorded, identified, compensated; then an effect drawn by chance appears, is flagged, named and
# compensated. dehyst demo ends with 0: so it was, 1: it was not, 77: this machine was too busy to
# judge; make itself turns 1 and 77 into its 2, so the recipe says which it was
demo: kernels
	@$(BIN)/dehyst demo --force || { code=$$?; $(SAY_CODE); exit $$code; }

# the same without the effect
first-act: kernels
	@$(BIN)/dehyst demo --force --first-act || { code=$$?; $(SAY_CODE); exit $$code; }

# quick: what starts no process and is soon done; see tests/parts.py
test: kernels
	$(BIN)/python -m tests.parts

quick: kernels
	$(BIN)/python -m tests.parts quick

# what `make test` leaves out because it takes longer; see tests/long.py
long: kernels
	$(BIN)/python -m tests.parts --long

check: lint types contracts docs test long

# numba compiles each kernel once and keeps it; without this the first start of a process would
kernels: $(READY)
	@$(BIN)/dehyst warm

lint: $(READY)
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .

types: $(READY)
	$(BIN)/mypy

contracts: $(READY)
	$(BIN)/lint-imports

# the pages as a site, out/site/index.html; a link that leads nowhere fails
docs: $(READY)
	NO_MKDOCS_2_WARNING=1 $(BIN)/mkdocs build

# docs/reference-*.md and docs/schemas, from the code
reference: $(READY)
	$(BIN)/python -m dehyst.daemon.reference docs
	$(BIN)/python -m dehyst.daemon.bus.contract docs/schemas

# installs and runs with every Python of pyproject.toml that is here; two minutes each
interpreters: $(READY)
	$(BIN)/python -m tests.packaging.interpreters

# dist/: wheel, sdist, constraints with hashes, SBOM, Debian package; checked, ten minutes;
# PUBLISH=1: refused while pyproject.toml names no public home
release: $(READY)
	$(BIN)/python -m pip install --quiet --editable '.[release]'
	$(BIN)/python -m release $(if $(PUBLISH),--publish)

concealed: $(READY)
	$(BIN)/python tests/concealed/make_answers.py $(ROUND)

proof: $(READY)
	$(BIN)/python -m tests.benchmarks.models.proof

fuzz: $(READY)
	-$(BIN)/python -m pip install --quiet atheris
	$(BIN)/python -m tests.fuzz --for $(FUZZ_S)

# about an hour; ONLY="--room gate" for a part of it
mutate: kernels
	$(BIN)/python -m tests.mutations $(ONLY)

$(READY): pyproject.toml
	$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11) and "dehyst needs Python 3.11 or later")'
	$(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet --upgrade pip
	$(BIN)/python -m pip install --quiet --editable '.[dev]'
	touch $(READY)

clean:
	rm -rf $(VENV) build dist src/*.egg-info out .pytest_cache .mypy_cache .ruff_cache
