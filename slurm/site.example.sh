# What one cluster needs. Copy it to slurm/site.sh, or anywhere and name it in GFMDLAYER_SITE, and keep what fits:
# slurm/submit.sh reads it where you submit, the jobs read it where they run. It is plain bash; each line is optional.

# The environment of a job. Jobs of sites with --export=NONE begin with an empty one: so it is made here, not inherited.
#module load python/3.11 openmpi/5.0
#source "$HOME/gfmdlayer/.venv/bin/activate"

# Options of every job. Slurm reads them where you submit.
#export SBATCH_ACCOUNT=my-project
#export SBATCH_PARTITION=standard
#export SBATCH_CONSTRAINT=icelake      # one type of CPU: results of all jobs then agree to the last bit
#export SBATCH_EXPORT=NONE

# The MPI launcher of ranks.sbatch; where the MPI was built for Slurm, srun with the --mpi type that `srun --mpi=list`
# names for it.
#LAUNCHER="srun --kill-on-bad-exit=1 --mpi=pmix"

# Sites that forbid requeue: jobs end with status 75 and go on in the next one of a chain, `submit.sh --chain 5`.
#REQUEUE=no

# A fast file system of the job: results are written there, begun from those in --out, and copied back when the run ends
# or is stopped. Of the ranks of one node; the jobs of an array share a folder, and need one that all of them see.
#SCRATCH=$TMPDIR

# Locks keep two runs from one folder. NFS needs version 4 or a lock daemon, Lustre the mount option flock (localflock
# locks within one node only); submit.sh tries a lock in the folder of the results and says where there is none.
