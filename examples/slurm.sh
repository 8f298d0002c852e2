#!/bin/bash
# A SLURM job of any of the three programs that goes on by itself:
#
#     sbatch examples/slurm.sh sph column-impact-f
#
# One rank per socket, its cores as threads. The program knows when the job ends and stops before that with a checkpoint
# (exit code 5): the script submits itself again, and `restart` goes on. `PROGRAM estimate CASE --ranks R --threads T`
# tells beforehand what a number of nodes takes.
#SBATCH --job-name=hpcpic
#SBATCH --nodes=2
#SBATCH --ntasks-per-node=2
#SBATCH --cpus-per-task=24
#SBATCH --time=02:00:00
#SBATCH --signal=USR1@300

set -euo pipefail
source .venv/bin/activate
program=$1 # hpcpic, sph or lbmdem
case=$2    # a shipped one by its name, or a file
out=runs/$(basename "$case" .conf)
export OMP_NUM_THREADS=1 SRUN_CPUS_PER_TASK=$SLURM_CPUS_PER_TASK

if [ -d "$out/checkpoints" ]; then
  srun --mpi=pmi2 "$program" restart "$out" --threads "$SLURM_CPUS_PER_TASK" || code=$?
else
  srun --mpi=pmi2 "$program" run "$case" --output "$out" --threads "$SLURM_CPUS_PER_TASK" || code=$?
fi
if [ "${code:-0}" -eq 5 ]; then sbatch examples/slurm.sh "$program" "$case"; fi
exit "${code:-0}"
