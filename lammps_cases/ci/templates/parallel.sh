#!/usr/bin/env bash
# All shards on this machine by GNU parallel (or, without it, xargs), JOBS at a time, and then joined: bash parallel.sh
set -euo pipefail
here=$(cd "$(dirname "$0")" && pwd)
jobs=${JOBS:-$(nproc)}
rm -f "$here"/shards/*.tar
if command -v parallel > /dev/null; then
  seq @SHARDS@ | parallel --will-cite -j "$jobs" "$(printf '%q' "$here/shard.sh")" || echo "shards with an exit code other than 0: $?"
else
  seq @SHARDS@ | xargs -P "$jobs" -n 1 "$here/shard.sh" || echo 'a shard ended with an exit code other than 0'
fi
"$here/merge.sh"
