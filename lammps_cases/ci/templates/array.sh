#!/usr/bin/env bash
# A job array, one task per shard, and a job that joins them when all have ended: bash array.sh; shards that are missing
# once more: bash array.sh 3,7. Partition, account, time: SBATCH_PARTITION, SBATCH_ACCOUNT, SBATCH_TIMELIMIT;
# CPUS: LAMMPS at a time in each.
set -euo pipefail
here=$(cd "$(dirname "$0")" && pwd)
mkdir -p "$here/shards" "$here/log"
if [ $# = 0 ]; then rm -f "$here"/shards/*.tar; fi
# shellcheck disable=SC2016 # the task takes its number
task=$(printf '%q ' exec "$here/shard.sh")'"$SLURM_ARRAY_TASK_ID"'
array=$(sbatch --parsable --job-name=eos-ref --array="${1:-1-@SHARDS@}" --cpus-per-task="${CPUS:-1}" \
  --requeue --open-mode=append --output="$here/log/%a.txt" --wrap "$task")
merge=$(sbatch --parsable --job-name=eos-ref-merge --dependency="afterany:${array%%;*}" \
  --output="$here/log/merge.txt" --wrap "$(printf '%q ' exec "$here/merge.sh")")
echo "array ${array%%;*}, merge ${merge%%;*}: the verdict will be in $here/log/merge.txt, the report in $here/report"
