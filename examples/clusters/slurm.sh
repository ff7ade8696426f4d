#!/bin/bash
# A season as an array of jobs, then one that joins its parts:
#   array=$(sbatch --parsable --array=1-16 slurm.sh logs/ ariac2024.release_5 season/)
#   sbatch --dependency=afterany:$array slurm.sh logs/ ariac2024.release_5 season/
# A job that was pre-empted or killed is sent again with the same command: what it has scored is kept.
#SBATCH --job-name=ariac-score
#SBATCH --cpus-per-task=2
#SBATCH --mem=18G
#SBATCH --time=04:00:00
#SBATCH --requeue
set -euo pipefail
logs=$1 rules=$2 season=${3%/}

code=0
if [ -z "${SLURM_ARRAY_TASK_ID:-}" ]; then # not of the array: join what its jobs have made
  ariac-score merge "$season" "$season".part_* || code=$?
else # beside the season and not in it; 1 to the number of jobs, as --shard counts
  shard=$SLURM_ARRAY_TASK_ID/$SLURM_ARRAY_TASK_COUNT
  ariac-score batch "$logs" --rules "$rules" -o "$season.part_$SLURM_ARRAY_TASK_ID" --shard "$shard" || code=$?
fi
# 6 says that some run should be looked at: no reason for the scheduler to call the job failed.
[ "$code" = 6 ] || exit "$code"
