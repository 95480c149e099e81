#!/usr/bin/env bash
# Key of the cache: the engine, and the content of what predictions depend on. Caches of other keys serve as a start.
set -euo pipefail
export LC_ALL=C

root="$GITHUB_ACTION_PATH/../../.."
mapfile -t cases < <(grep -v '^[[:space:]]*$' <<< "${EOS_REF_CASES:-}" || true)

files() {
    find "$root/eos_ref" "$root/lammps_cases" -type f \( -name '*.py' -o -name '*.yaml' \) -print0
    if ((${#cases[@]})); then
        find "${cases[@]}" -type f \( -name '*.yaml' -o -name '*.yml' \) -print0
    fi
}

key="$({ printf '%s\n' "${EOS_REF_ENGINE:-env}" && files | sort -z | xargs -0 cat; } | sha256sum | cut -c1-16)"
echo "key=$key" >> "$GITHUB_OUTPUT"
