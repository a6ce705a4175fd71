#!/bin/bash
# Submits a sweep with what the site file of your cluster says (slurm/site.example.sh), and the memory that
# `gfmdlayer check` finds:
#
#     bash slurm/submit.sh --ranks 64 configs/figure2.yaml --time 24:00:00
#     bash slurm/submit.sh --array 16 configs/figure2.yaml --time 24:00:00
#
# --ranks N    one job of N MPI ranks (ranks.sbatch)
# --array N    N jobs that share the cases (array.sbatch)
# --chain N    N jobs, each beginning when the one before has ended, where requeue is forbidden (default 1)
# --out DIR    folder of the results
# --dry        print the commands, and submit nothing
# Other options go to sbatch.
set -euo pipefail

here=$(cd "$(dirname "${BASH_SOURCE[0]}")" && pwd)
fail() { echo "submit.sh: $1" >&2; exit 2; }
site=${GFMDLAYER_SITE:-$here/site.sh}
[[ -f $site || -z ${GFMDLAYER_SITE-} ]] || fail "GFMDLAYER_SITE: $site does not exist"
# shellcheck source=site.example.sh
[[ ! -f $site ]] || source "$site"

script="" number="" chain=1 config="" run=batch options=() arguments=()
whole() { [[ $2 =~ ^[1-9][0-9]*$ ]] || fail "$1: got ${2:-nothing}; must be a whole number from 1"; }
while (($#)); do
    case $1 in
        --ranks | --array) whole "$1" "${2-}" && script=${1#--} number=$2 && shift ;;
        --chain) whole "$1" "${2-}" && chain=$2 && shift ;;
        --out) [[ -n ${2-} ]] || fail "--out: names no folder"; arguments+=(--out "$2"); shift ;;
        --dry) run=dry ;;
        -*) options+=("$1"); if [[ $1 != *=* && ${2-} != -* && ${2-} != *.y*ml && -n ${2-} ]]; then options+=("$2"); shift; fi ;;
        *) [[ -z $config ]] || fail "got $1 beside $config; must be one configuration"; config=$1 ;;
    esac
    shift
done
[[ -n $script ]] || fail "must have --ranks N or --array N"
[[ -f $config ]] || fail "${config:-no configuration}: no such file"
[[ ${REQUEUE-yes} == yes || $chain -gt 1 ]] ||
    echo "submit.sh: REQUEUE=no and --chain 1: a run that its time limit stops goes on when you submit it again" >&2

checked=$(gfmdlayer check "$config" "${arguments[@]}") || { echo "$checked"; exit 2; }
echo "$checked"
# Memory of one process in MB, half as much again for what else a process holds.
memory=$(awk '$1 == "memory" { unit["KB"] = .001; unit["MB"] = 1; unit["GB"] = 1000; unit["TB"] = 1e6
    for (i = 2; i < NF; i++) if ($(i + 1) in unit) { print int(1.5 * $i * unit[$(i + 1)]) + 200; exit } }' <<<"$checked")
[[ -z $memory ]] || options=("--mem-per-cpu=${memory}M" "${options[@]}")

folder=$(sed -n 's/^disk .* in //p' <<<"$checked")
while [[ -n $folder && ! -d $folder ]]; do folder=$(dirname "$folder"); done
probe=${folder:-.}/.lock-$$
if ! flock --nonblock "$probe" true 2>/dev/null; then
    echo "submit.sh: no locks in ${folder:-.}: two runs there would not see each other (slurm/site.example.sh)" >&2
fi
rm -f "$probe"

[[ $script == ranks ]] && options+=("--ntasks=$number") || options+=("--array=1-$number")
[[ ${REQUEUE-yes} == yes ]] || options+=(--no-requeue)
export GFMDLAYER_SITE=$site
[[ -f $site ]] || unset GFMDLAYER_SITE
# Where the environment is not exported, the job still has to find its site file.
[[ ${SBATCH_EXPORT-} != NONE || ! -f $site ]] || export SBATCH_EXPORT="GFMDLAYER_SITE=$site"
after=()
for ((i = 0; i < chain; i++)); do
    command=(sbatch --parsable "${options[@]}" "${after[@]}" "$here/$script.sbatch" "$config" "${arguments[@]}")
    echo "${command[*]}"
    if [[ $run == batch ]]; then job=$("${command[@]}"); echo "submitted $job"; else job=JOB$i; fi
    after=("--dependency=afterany:${job%%;*}")
done
