#!/usr/bin/env bash
# Renews the tables that are measured on a GPU.
#
#     docs/benchmarks/gpu.sh OUT CASES [PART ...]      (default: all parts, in the order below)
#
# OUT: a folder for what comes out. CASES: a folder with the cases etna2001 and etna2006 (docs/VALIDATION.md). Each
# part is cut off after its limit; what it wrote until then stays. `python3` has to find lava_ros and its packages.
set -u
out=$(realpath "${1:?usage: gpu.sh OUT CASES [PART ...]}"); cases=$(realpath "${2:?usage: gpu.sh OUT CASES [PART ...]}")
shift 2
cd "$(dirname "$0")/../.." || exit
export PYTHONPATH=$PWD:$PWD/tests:$PWD/docs/benchmarks${PYTHONPATH:+:$PYTHONPATH}
lava="python3 -m lava_ros.cli.main"
many="python3 docs/benchmarks/members.py --device cuda:0 --machine GPU"
both="--case $cases/etna2001 --case $cases/etna2006"

declare -A command=(
    [batch]="python3 -m pytest -q -p no:cacheprovider -p no:launch_testing tests/simulation/test_batch.py tests/simulation/test_arrival.py"
    [members]="$lava check speed members --device cuda:0 -o $out/members.csv"
    [day]="$many $cases/etna2001 --members 256 --repetitions 3"
    [day_standard]="$many $cases/etna2001 --members 256 --repetitions 3 --preset standard"
    [whole]="$many $cases/etna2001 --members 1000 --days 22"
    [atlas]="python3 docs/benchmarks/atlas.py $cases/etna2001 $out/atlas --members 500 --device cuda:0 --machine GPU"
    [live]="python3 docs/benchmarks/forecast.py cuda:0 GPU 256"
    [hard]="python3 -m hard.run --device cuda:0 --jobs 8 --csv $out"
    [steps]="$lava check speed steps --device cuda:0 --repetitions 5 -o $out/steps_h200.csv"
    [effects]="$lava check speed effects --device cuda:0 --repetitions 5 -o $out/effects_h200.csv"
    [accuracy]="$lava check accuracy --device cuda:0 --case green --case radiating_sheet --longest 20 -o $out/accuracy"
    [calibrate]="$lava calibrate $cases/etna2001 $cases/etna2006 --preset standard --directions 4 --device cuda:0 -o $out/calibration"
    [eruptions]="python3 docs/benchmarks/eruptions.py $out/eruptions_h200.csv $both --preset standard --runs 8 --device cuda:0 --machine GPU"
    [probability]="python3 docs/benchmarks/probability.py $out/probability_h100.csv $both --folder $out/members --members 64 --preset draft --device cuda:0 --machine GPU"
)
declare -A limit=(
    [batch]=120 [members]=280 [day]=100 [day_standard]=120 [whole]=400 [atlas]=400 [live]=110 [hard]=230 [steps]=100 [effects]=90 [accuracy]=80
    [calibrate]=500 [eruptions]=300 [probability]=500
)
[ $# -gt 0 ] || set -- batch members day day_standard whole atlas live hard steps effects accuracy calibrate eruptions probability
mkdir -p "$out"
for part; do
    begun=$SECONDS
    timeout "${limit[$part]:?no part $part}" ${command[$part]} > "$out/$part.txt" 2>&1
    echo "$part: status $?, $((SECONDS - begun)) s"
    tail -n 20 "$out/$part.txt"
done
