#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# docs/ as a site in build/site. A link that leads nowhere ends it with exit status 1.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/../.."
env=build/docs-env
mkdir -p build
if ! cmp -s tools/docs/requirements.txt "$env/installed"; then
  echo "[docs] installing mkdocs into $env"
  python3 -m venv "$env"
  "$env/bin/pip" install -q --disable-pip-version-check -r tools/docs/requirements.txt >build/docs-pip.log 2>&1 ||
    { tail -5 build/docs-pip.log >&2; echo "[docs] ERROR: pip could not install it (whole log: build/docs-pip.log)" >&2; exit 1; }
  cp tools/docs/requirements.txt "$env/installed"
fi
NO_MKDOCS_2_WARNING=1 "$env/bin/mkdocs" build --quiet --strict -f tools/docs/mkdocs.yml
echo "[docs] wrote build/site: open build/site/index.html, or: python3 -m http.server -d build/site (search works then)"
