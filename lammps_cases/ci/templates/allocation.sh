#!/usr/bin/env bash
# All shards in one allocation, a task each, and then joined: bash allocation.sh, or inside of salloc.
# Partition, account, time: SBATCH_PARTITION, SBATCH_ACCOUNT, SBATCH_TIMELIMIT; CPUS: LAMMPS at a time in each.
set -euo pipefail
here=$(cd "$(dirname "$0")" && pwd)
mkdir -p "$here/shards" "$here/log"
if [ -z "${SLURM_JOB_ID:-}" ]; then
  exec sbatch --job-name=eos-ref --ntasks=@SHARDS@ --cpus-per-task="${CPUS:-1}" \
    --requeue --open-mode=append --output="$here/log/allocation.txt" --wrap "$(printf '%q ' exec "$here/allocation.sh")"
fi
if [ "${SLURM_RESTART_COUNT:-0}" = 0 ]; then rm -f "$here"/shards/*.tar; fi  # requeued: what is done stays
srun -n @SHARDS@ -c "${SLURM_CPUS_PER_TASK:-1}" --mpi=none --kill-on-bad-exit=0 "$here/shard.sh" \
  || echo "a shard ended with exit code $?"
"$here/merge.sh"
