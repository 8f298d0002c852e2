#!/bin/bash
# SLURM: one rank per socket, its cores as threads; stops itself with a checkpoint before the time is up and goes on
# when submitted again (exit code 5 means: resubmit). `hpcpic estimate CASE --ranks R --threads T` says beforehand how
# efficient a number of nodes will be.
#SBATCH --job-name=hpcpic
#SBATCH --nodes=2
#SBATCH --ntasks-per-node=2
#SBATCH --cpus-per-task=24
#SBATCH --time=02:00:00
#SBATCH --signal=USR1@300

set -euo pipefail
source .venv/bin/activate
case=${1:-magnetised-thermal-2d}
out=runs/$case
export OMP_NUM_THREADS=1

if [ -d "$out/checkpoints" ]; then
  srun --mpi=pmi2 hpcpic restart "$out" --threads "$SLURM_CPUS_PER_TASK" || code=$?
else
  srun --mpi=pmi2 hpcpic run "$case" --output "$out" --threads "$SLURM_CPUS_PER_TASK" --wall 01:50:00 || code=$?
fi
# 5: stopped early with a checkpoint. Submit the same script again; it goes on from there.
if [ "${code:-0}" -eq 5 ]; then sbatch "$0" "$case"; fi
exit "${code:-0}"
