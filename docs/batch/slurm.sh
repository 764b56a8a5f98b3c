#!/bin/bash
# A share of a batch, as one job of an array. The last word is the number of shares, so that jobs
# that failed can run again alone:
#
#   sbatch --array=0-39 slurm.sh cases.csv out 40
#   sbatch --array=3,17 slurm.sh cases.csv out 40
#
#SBATCH --cpus-per-task=2
#SBATCH --mem=1G
#SBATCH --time=01:00:00
set -uo pipefail
if [ $# -ne 3 ]; then
    echo "usage: sbatch --array=0-39 slurm.sh MANIFEST.csv OUT 40" >&2
    exit 2
fi
export RAYON_NUM_THREADS=${SLURM_CPUS_PER_TASK:-1}
"${SOFTRIG:-softrig}" diagnose --batch "$1" -o "$2" --share "$SLURM_ARRAY_TASK_ID/$3"
code=$?
if [ $code -ne 0 ]; then
    echo "job $SLURM_ARRAY_TASK_ID of $3 on $(hostname): exit $code" >&2
fi
exit $code
