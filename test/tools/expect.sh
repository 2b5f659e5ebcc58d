# shellcheck shell=bash disable=SC2034
# Sourced by tests of command lines, from a folder of their own: the tests count failures.
bin=$(realpath "${1:?folder of the programs}")
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
cd "$work" || exit 1
failures=0

fail() {
  echo "FAILED: $*"
  failures=$((failures + 1))
}

# expect CODE TEXT COMMAND...: runs the command, compares its exit code and looks for TEXT in what it prints.
expect() {
  local code=$1 text=$2 output got
  shift 2
  output=$("$@" 2>&1)
  got=$?
  if [ "$got" -ne "$code" ] || ! grep -qF -- "$text" <<<"$output"; then
    fail "$* -> $got (expected $code and \"$text\"): $output"
  fi
}
