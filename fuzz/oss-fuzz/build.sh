#!/bin/bash -eu
# One program for each target, with its seeds and its words: `$OUT/fuzz_NAME`, `_seed_corpus.zip`, `.dict`.
# Run by OSS-Fuzz in the folder of the checkout, with `compile_python_fuzzer` in the path.
pip3 install . mcap
# Plugins are found through entry points, which PyInstaller does not follow: with their modules and what the wheel says.
ours=""
for package in ariac_score plugins/*/; do
  ours="$ours --collect-all $(basename "$package")"
done
for folder in fuzz/corpus/*/; do
  name=$(basename "$folder")
  sed "s/@TARGET@/$name/" fuzz/oss-fuzz/fuzz_target.py.in >"fuzz_$name.py"
  compile_python_fuzzer "fuzz_$name.py" --paths . $ours --copy-metadata ariac-score --collect-all rosbags --collect-all jsonschema_specifications
  zip -q -j "$OUT/fuzz_${name}_seed_corpus.zip" "$folder"*
done
python3 fuzz/run --words "$OUT"
