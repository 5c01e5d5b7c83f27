#!/bin/sh
# Makes the packaged detector from nothing: pictures, both networks, and the figures of README.md.
#
#   experiments/detector/train.sh OUT [HOURS]
#
# OUT holds all files. HOURS is the time of the training (default 6), which adapts to it. Before it come about 10 minutes of
# ray tracing and 12 of composing on one free core, after it a few minutes of evaluation. The same command continues where it
# was interrupted; rpojax uses every core, or the GPU.
set -eu
out=${1:?"usage: train.sh OUT [HOURS]"}
minutes=$(( ${2:-6} * 60 ))
mkdir -p "$out"

# Pictures to train on, and, by the generators of the first weights and of these, pictures to judge by.
rpojax detector data --out "$out/second" --count 8000 --validation 2600 --seed 0
for name in second-empty first first-empty; do
    [ -e "$out/$name.work" ] || ln -s second.work "$out/$name.work"  # the same ray traces
done
rpojax detector data --out "$out/second-empty" --count 1 --validation 2000 --seed 0 --generator 2-empty
rpojax detector data --out "$out/first" --count 6000 --validation 2800 --seed 0 --generator 1
rpojax detector data --out "$out/first-empty" --count 1 --validation 2000 --seed 0 --generator 1-empty

# The proposal network on crops and then on whole pictures, then the refinement network on its boxes.
[ -e "$out/detector.safetensors" ] ||
    rpojax detector train "$out/second" "$out/first" --out "$out/detector.safetensors" \
        --epochs 100000 --second-epochs 100000 --minutes "$minutes"

for set in first first-empty second second-empty; do
    rpojax detector evaluate "$out/$set" --weights "$out/detector.safetensors" --json > "$out/$set.json"
done
