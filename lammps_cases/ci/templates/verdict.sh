#!/usr/bin/env bash
# What eos-ref says of a build of LAMMPS: build directory in, verdict out.
#
#   ./eos-ref.sh BUILD [OPTION of eos-ref run]...        ./eos-ref.sh build --tag quick --fail-on high
#
# BUILD holds liblammps.so, made with BUILD_SHARED_LIBS=on and the packages BPM and RHEO; its Python sources are taken
# from ../python/lammps, so that nothing needs to be installed. Twins on two ranks need a library with MPI (MPICH).
# Exit codes: 0 as expected (known findings included, unless --fail-on), 1 something differs, 2 bad input, 3 LAMMPS failed or is missing.
#
# Environment:  EOS_REF          what pip installs eos-ref from
#               EOS_REF_VENV     virtual environment to install it into, once (BUILD/eos-ref-venv)
#               EOS_REF_REPORT   folder of the report (eos-ref-report)
set -euo pipefail

if (($# < 1)); then
    echo "usage: $0 BUILD [OPTION of eos-ref run]..." >&2
    exit 2
fi
build="$(cd "$1" && pwd)" || exit 2
shift
if [[ ! -e "$build/liblammps.so" ]]; then
    echo "$0: build: must hold liblammps.so (cmake -D BUILD_SHARED_LIBS=on) ($build)" >&2
    exit 2
fi

venv="${EOS_REF_VENV:-$build/eos-ref-venv}"
if [[ ! -x "$venv/bin/eos-ref" ]]; then
    python3 -m venv "$venv" || exit 3
    "$venv/bin/python" -m pip install --quiet --disable-pip-version-check \
        "${EOS_REF:-eos-ref @ git+https://github.com/@REPOSITORY@}" || exit 3
fi
exec "$venv/bin/eos-ref" run --engine "path:$build" --out "${EOS_REF_REPORT:-eos-ref-report}" "$@"
