#!/usr/bin/env bash
# Shard I of @SHARDS@ on this node: shard.sh I; without I that of the task of srun. Leaves one file, shards/I.tar, once it
# is whole. Needs no internet. What a run reads and writes often lies on the node, below TMPDIR.
set -euo pipefail
here=$(cd "$(dirname "$0")" && pwd)
i=${1:-$((SLURM_PROCID + 1))}
file=$here/shards/$i.tar
if [ $# = 0 ] && [ -e "$file" ]; then
  echo "shard $i is done: $file"
  exit 0
fi
eos_ref=${EOS_REF:-@PROGRAM@}
node=${TMPDIR:-/tmp}/eos-ref-$(id -u)
work=$node/$(basename "$here")-${SLURM_JOB_ID:-$$}/$i
rm -f "$file"
mkdir -p "$work" "$here/shards"
export EOS_REF_PREDICTIONS=${EOS_REF_PREDICTIONS:-$node/predictions} EOS_REF_HISTORY=off
cd @FOLDER@
code=0
"$eos_ref" run @OPTIONS@ --shard "$i/@SHARDS@" --costs "$here/costs.json" \
  --jobs "${SLURM_CPUS_PER_TASK:-1}" --out "$work/$i" --resume || code=$?
if [ ! -e "$work/$i/run.json" ]; then exit "$code"; fi  # interrupted: goes on if it is requeued to this node
tar -cf "$work/$i.tar" -C "$work" "$i"
cp "$work/$i.tar" "$file.partial.${SLURM_JOB_ID:-$$}"
mv "$file.partial.${SLURM_JOB_ID:-$$}" "$file"
rm -rf "$work"
exit "$code"
