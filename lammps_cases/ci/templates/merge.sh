#!/usr/bin/env bash
# All shards, joined: merge.sh [REPORT]. Names those that are missing; its exit code is that of the whole run.
set -euo pipefail
here=$(cd "$(dirname "$0")" && pwd)
work=$(mktemp -d "${TMPDIR:-/tmp}/eos-ref-merge.XXXXXX")
trap 'rm -rf "$work"' EXIT
for file in "$here"/shards/*.tar; do
  if [ ! -e "$file" ]; then
    echo "merge: no shard is done: $here/shards is empty" >&2
    exit 2
  fi
  tar -xf "$file" -C "$work"
done
report=${1:-$here/report}
eos_ref=${EOS_REF:-@PROGRAM@}
cd @FOLDER@
"$eos_ref" merge "$work"/* --out "$report"
