#!/usr/bin/env bash
# Runs the cases and audits the decks that the inputs of the action name, and leaves the worst exit code as an output:
# the job fails later, when the reports are kept. Inputs are EOS_REF_... in the environment; lists have a line each.
set -uo pipefail
shopt -s globstar nullglob

reports="${EOS_REF_REPORTS:-reports}"
worst=0

lines() { # the non-empty lines of a text
    grep -v '^[[:space:]]*$' <<< "$1"
}

keep() { # the worst exit code so far
    if (($1 > worst)); then worst=$1; fi
}

shared=(--engine "${EOS_REF_ENGINE:-env}")
if [[ "${EOS_REF_FAIL_ON:-new}" != new ]]; then shared+=(--fail-on "$EOS_REF_FAIL_ON"); fi
if [[ "${EOS_REF_STRICT:-}" == true ]]; then shared+=(--strict); fi

if [[ -z "${EOS_REF_DECKS:-}" || -n "${EOS_REF_CASES:-}${EOS_REF_NAMES:-}${EOS_REF_TAG:-}" ]]; then
    options=("${shared[@]}" --out "$reports/cases")
    while IFS= read -r path; do options+=(--cases "$path"); done < <(lines "${EOS_REF_CASES:-}")
    if [[ -n "${EOS_REF_TAG:-}" ]]; then options+=(--tag "$EOS_REF_TAG"); fi
    if [[ -n "${EOS_REF_BASELINE:-}" ]]; then options+=(--baseline "$EOS_REF_BASELINE"); fi
    mapfile -t names < <(lines "${EOS_REF_NAMES:-}")
    if ((${#names[@]})); then options+=(-- "${names[@]}"); fi
    eos-ref run "${options[@]}"
    keep $?
fi

read -ra audit_options <<< "${EOS_REF_AUDIT_OPTIONS:-}"
while IFS= read -r pattern; do
    found=0
    IFS='' # a pattern may hold spaces
    for deck in $pattern; do
        [[ -f "$deck" || (-d "$deck" && "$deck" == "$pattern") ]] || continue
        found=1
        name="${deck//\//-}"
        out="$reports/audit-${name// /-}"
        echo "::group::audit of $deck"
        summary="$(mktemp)"
        GITHUB_STEP_SUMMARY="$summary" eos-ref audit "$deck" "${shared[@]}" "${audit_options[@]}" --out "$out"
        keep $?
        before="${EOS_REF_TARGET:-}/$deck/eos-ref-baseline"
        if [[ -n "${EOS_REF_TARGET:-}" && -f "$before/baseline.json" && -f "$out/run.json" ]]; then
            eos-ref compare "$before" "$out" --out "$out-since-target" # what changed is news, not a failure
            cat "$out-since-target/summary.md" >> "${GITHUB_STEP_SUMMARY:-/dev/null}"
        fi
        cat "$summary" >> "${GITHUB_STEP_SUMMARY:-/dev/null}"
        echo "::endgroup::"
    done
    if ((!found)); then
        echo "::error title=eos-ref::no deck matches: $pattern"
        keep 2
    fi
done < <(lines "${EOS_REF_DECKS:-}")

{
    echo "exit-code=$worst"
    echo "report=$reports"
} >> "$GITHUB_OUTPUT"
