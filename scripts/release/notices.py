#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Writes NOTICE and an SBOM of a build from the table third_party.json, or checks programs against it.

    notices.py write --have ZLIB,WEB,... [--static] --version V [--cuda V] OUT
    notices.py check --have ... [--static] FILE...      every NEEDED library has a row
    notices.py pages                                    every bundled web package has a row

A row has `name license copyright source`, and
  how       header | static | bundled: it is inside the build; shared: the build loads it;
            library: static in a build with GS_STATIC_LIBRARIES, else shared
  when      the part of the build that brings it: GS_HAVE_<when>; none: every build
  version   where to ask: dpkg:PACKAGE, npm:PACKAGE or cuda; or what came with:NAME VERSION into this tree
  sonames   names of its shared libraries, up to ".so"; of `header`, where the build may load one, too
"""
import argparse
import datetime
import hashlib
import json
import os
import re
import subprocess
import sys
from pathlib import Path

HERE = Path(__file__).resolve().parent
WEB = HERE.parent.parent / "apps" / "web"
INSIDE = ("header", "static", "bundled")


def read_table():
    return json.loads((HERE / "third_party.json").read_text(encoding="utf-8"))


def rows_of(have, static):
    """The rows of a build, each with its `how` decided."""
    rows = []
    for row in read_table():
        if row.get("when") and row["when"] not in have:
            continue
        how = row["how"]
        if how == "library":
            how = "static" if static else "shared"
        rows.append(row | {"how": how})
    return rows


# ---- versions ---------------------------------------------------------------------------------------

def dpkg_version(package):
    try:
        answer = subprocess.run(["dpkg-query", "-W", "-f", "${Version}\n", package], capture_output=True, text=True, check=True)
    except (OSError, subprocess.CalledProcessError):
        return None
    return answer.stdout.split("\n")[0] or None


def npm_version(package):
    lock = json.loads((WEB / "package-lock.json").read_text(encoding="utf-8"))
    entry = lock["packages"].get("node_modules/" + package)
    return entry and entry["version"]


def version_of(row, cuda):
    kind, _, package = row["version"].partition(":")
    return {"dpkg": dpkg_version, "npm": npm_version, "cuda": lambda _: cuda or None, "with": lambda name: f"({name})"}[kind](package)


# ---- NOTICE -----------------------------------------------------------------------------------------

def license_ids(expression):
    return [word for word in re.split(r"\s+|[()]", expression) if word and word not in ("AND", "OR", "WITH")]


def license_texts(rows):
    """The text of each license, once, in the order of first use."""
    texts = {}
    for row in rows:
        for name in license_ids(row["license"]):
            file = HERE / "licenses" / (name + ".txt")
            if name == "GPL-3.0-or-later":  # only with GCC's exception, whose text names it
                continue
            texts[name] = file.read_text(encoding="utf-8")
    return texts


def notice(rows, version, cuda):
    inside = [row for row in rows if row["how"] in INSIDE]
    parts = [f"gemsplat {version}\nCopyright the gemsplat developers\nLicensed under the Apache License, Version 2.0.\n",
             "It contains these works of others, under the licenses below:\n"]
    for row in inside:
        found = version_of(row, cuda)
        parts.append(f"{row['name']}{' ' + found if found else ''}  {row['source']}\n"
                     f"  Copyright (c) {row['copyright']}\n  License: {row['license']}\n")
    for name, text in license_texts(inside).items():
        parts.append(f"{'-' * 80}\n{name}\n\n{text}")
    return "\n".join(parts)


# ---- SBOM -------------------------------------------------------------------------------------------

def spdx_id(name):
    return "SPDXRef-" + re.sub(r"[^A-Za-z0-9.]+", "-", name)


def spdx_package(row, cuda):
    return {"SPDXID": spdx_id(row["name"]), "name": row["name"], "versionInfo": version_of(row, cuda) or "NOASSERTION",
            "licenseConcluded": row["license"], "licenseDeclared": row["license"],
            "copyrightText": "Copyright (c) " + row["copyright"], "downloadLocation": "NOASSERTION",
            "homepage": row["source"], "filesAnalyzed": False, "comment": row["how"]}


def sbom(rows, version, cuda, seconds):
    own = {"SPDXID": "SPDXRef-gemsplat", "name": "gemsplat", "versionInfo": version, "licenseConcluded": "Apache-2.0",
           "licenseDeclared": "Apache-2.0", "copyrightText": "Copyright the gemsplat developers",
           "downloadLocation": "NOASSERTION", "filesAnalyzed": False}
    packages = [own] + [spdx_package(row, cuda) for row in rows]
    relationships = [{"spdxElementId": "SPDXRef-DOCUMENT", "relationshipType": "DESCRIBES", "relatedSpdxElement": own["SPDXID"]}]
    for row in rows:
        kind = "CONTAINS" if row["how"] in INSIDE else "DEPENDS_ON"
        relationships.append({"spdxElementId": own["SPDXID"], "relationshipType": kind, "relatedSpdxElement": spdx_id(row["name"])})
    custom = sorted({name for row in rows for name in license_ids(row["license"]) if name.startswith("LicenseRef-")})
    texts = [{"licenseId": name, "extractedText": (HERE / "licenses" / (name + ".txt")).read_text(encoding="utf-8")} for name in custom]
    created = datetime.datetime.fromtimestamp(seconds, datetime.timezone.utc).strftime("%Y-%m-%dT%H:%M:%SZ")
    content = hashlib.sha256(json.dumps([packages, created]).encode()).hexdigest()[:32]
    return {"spdxVersion": "SPDX-2.3", "dataLicense": "CC0-1.0", "SPDXID": "SPDXRef-DOCUMENT", "name": f"gemsplat-{version}",
            "documentNamespace": f"https://spdx.org/spdxdocs/gemsplat-{version}-{content}",
            "creationInfo": {"created": created, "creators": ["Tool: gemsplat-notices"]},
            "packages": packages, "relationships": relationships} | ({"hasExtractedLicensingInfos": texts} if texts else {})


def write(arguments):
    rows = rows_of(arguments.have, arguments.static)
    seconds = int(os.environ.get("SOURCE_DATE_EPOCH") or datetime.datetime.now().timestamp())
    out = Path(arguments.out)
    out.mkdir(parents=True, exist_ok=True)
    (out / "NOTICE").write_text(notice(rows, arguments.version, arguments.cuda), encoding="utf-8")
    document = sbom(rows, arguments.version, arguments.cuda, seconds)
    (out / "sbom.spdx.json").write_text(json.dumps(document, indent=1, ensure_ascii=False) + "\n", encoding="utf-8")


# ---- checks -----------------------------------------------------------------------------------------

def needed(file):
    answer = subprocess.run(["readelf", "-dW", file], capture_output=True, text=True, check=True, env=os.environ | {"LC_ALL": "C"})
    return re.findall(r"\(NEEDED\).*\[(.+?)\]", answer.stdout)


def unexpected(files, rows, static):
    may_load = ("shared",) if static else ("shared", "header")
    known = {name for row in rows if row["how"] in may_load for name in row.get("sonames", [])}
    return [f"{file} needs {library}" for file in files for library in needed(file) if library.split(".so")[0] not in known]


def check(arguments):
    missing = unexpected(arguments.files, rows_of(arguments.have, arguments.static), arguments.static)
    if missing:
        sys.exit("error: " + "\n       ".join(missing) + "\nEither the build machine has a library that others lack, or "
                 "scripts/release/third_party.json lacks a row (docs/develop/releases.md)")
    print(f"{len(arguments.files)} files need nothing unexpected")


def bundled_packages():
    """The packages that build.mjs puts into pages, by name."""
    text = (WEB / "build.mjs").read_text(encoding="utf-8")
    lists = re.search(r"const PAGES = \{(.*?)\};", text, re.S).group(1)
    return sorted(set(re.findall(r"'([^']+)'", lists)))


def pages(_):
    rows = {row["version"].partition(":")[2] for row in read_table() if row["how"] == "bundled"}
    missing = [name for name in bundled_packages() if name not in rows or not npm_version(name)]
    if missing or not rows:
        sys.exit(f"error: third_party.json or package-lock.json lacks {', '.join(missing)}, which apps/web/build.mjs bundles")
    print(f"{len(rows)} web packages have a row")


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    verbs = parser.add_subparsers(required=True)
    for name, action in (("write", write), ("check", check), ("pages", pages)):
        verb = verbs.add_parser(name)
        verb.set_defaults(action=action)
        verb.add_argument("--have", type=lambda text: set(re.split("[,;]", text)), default=set())
        verb.add_argument("--static", action="store_true")
        if name == "write":
            verb.add_argument("--version", required=True)
            verb.add_argument("--cuda", default="")
            verb.add_argument("out")
        if name == "check":
            verb.add_argument("files", nargs="+")
    arguments = parser.parse_args()
    arguments.action(arguments)


if __name__ == "__main__":
    main()
