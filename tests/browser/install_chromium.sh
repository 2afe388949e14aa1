#!/bin/sh
# Installs Debian's Chromium for the tests of the pages, if it is missing and we may. Never fails:
# without it those tests are skipped and say so.
set -u

if [ -x /usr/bin/chromium ]; then
    exit 0
fi
if [ "$(id -u)" -ne 0 ] || ! command -v apt-get >/dev/null 2>&1; then
    echo "NOTE: there is no /usr/bin/chromium, so THE PAGES WILL NOT BE TESTED." >&2
    echo "      On Debian: sudo apt-get install chromium" >&2
    exit 0
fi
echo "installing Chromium for the tests of the pages" >&2
export DEBIAN_FRONTEND=noninteractive
if ! { apt-get update -qq && apt-get install -y -qq --no-install-recommends chromium fonts-dejavu-core; } >/dev/null; then
    echo "NOTE: Chromium could not be installed, so THE PAGES WILL NOT BE TESTED." >&2
fi
