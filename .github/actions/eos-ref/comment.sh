#!/usr/bin/env bash
# Puts the news of all reports of this job into one comment of the pull request, which later runs of it edit in place.
# A comment that cannot be written (a pull request from a fork has no right to) leaves the verdict as it is.
set -uo pipefail
shopt -s nullglob

marker="<!-- eos-ref: ${EOS_REF_ARTIFACT:-eos-ref-report} -->"
body="$RUNNER_TEMP/eos-ref-comment.md"
comments="repos/$GITHUB_REPOSITORY/issues/$EOS_REF_PULL_REQUEST/comments"

{
    echo "$marker"
    for run in "${EOS_REF_REPORTS:-reports}"/*/run.json; do eos-ref report "${run%/run.json}" --news; done
} > "$body"

mine=".[] | select(.body | startswith(\"$marker\")) | .id"
if found=$(gh api --paginate "$comments" --jq "$mine") && read -r id _ <<< "${found//$'\n'/ }"; then
    if [[ -n "$id" ]]; then
        gh api --silent --method PATCH "repos/$GITHUB_REPOSITORY/issues/comments/$id" --field "body=@$body" && exit 0
    else
        gh api --silent --method POST "$comments" --field "body=@$body" && exit 0
    fi
fi
echo "::warning title=eos-ref::the comment could not be written: the job needs permissions: pull-requests: write"
