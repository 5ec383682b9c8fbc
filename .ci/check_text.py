"""What is written: plain words, documents that are short enough, links and names that exist, the drawn map of crates."""
import json
import pathlib
import re
import subprocess

ROOT = pathlib.Path(__file__).resolve().parent.parent
files = subprocess.run(["git", "ls-files"], cwd=ROOT, capture_output=True, text=True, check=True).stdout.split("\n")
NOT_OURS = re.compile(r"CHANGELOG\.md|\.lock$|/dist/|package-lock\.json|\.ci/check_text\.py|\.(png|jpe?g|mp4)$")
texts = {}
for name in files:
    if name and not NOT_OURS.search(name):
        try:
            texts[name] = (ROOT / name).read_text()
        except UnicodeDecodeError:
            pass
faults, words = [], []

# Words that are no term of the glossary, in text and inside identifiers; broken up here so that a search for them finds nothing.
STEM = (r"(?:[Uu]n)?[Tt](?:old|ells?|elling)|(?:[Uu]n)?[Ff]ore(?:seen?|sees|seeing)|[Ss](?:ights?|ighted|ightings?)|[Tt]h(?:ings?)"
        r"|[Ll](?:asting)|[Ss]t(?:ays?|ayed|aying)|[Ss]ett(?:les?|led|ling)")
DIALECT = re.compile(
    rf"(?<![a-zA-Z])(?:{STEM}|m(?:ade|akes?|aking) ready|by s(?:o) much)(?![a-zA-Z])|(?<![A-Z])(?=[A-Z])(?:{STEM}|F(?:ront))(?![a-z])"
    r"|(?<![_a-zA-Z.])f(?:ront)(?![a-zA-Z(])")
for name, text in texts.items():
    for number, line in enumerate(text.split("\n"), 1):
        if match := DIALECT.search(line):
            words.append(f"{name}:{number}: `{match[0]}` is not a term of CONVENTIONS.md: {line.strip()[:90]}")

for name, most in {"README.md": 150, "ARCHITECTURE.md": 150}.items():
    if (lines := texts[name].count("\n")) > most:
        faults.append(f"{name} has {lines} lines, {most} at most")

# Files that read in one sitting; a file of tests, or tests at the end of one, may be longer.
TESTS = re.compile(r"(^|/)(tests|\w+_tests)(\.rs|/)")
for name, text in texts.items():
    if name.endswith(".rs") and not TESTS.search(name):
        inner = re.search(r"^#\[cfg\(test\)\]\nmod \w+ \{", text, re.M)
        if (lines := text[:inner.start() if inner else None].count("\n")) > 400:
            faults.append(f"{name} has {lines} lines without tests, 400 at most")

# Links between documents.
for name, text in texts.items():
    if name.endswith(".md"):
        for link in re.findall(r"\]\(([^)#: ]+)[^): ]*\)", text):
            if not (ROOT / name).parent.joinpath(link).exists():
                faults.append(f"{name}: there is no {link}")

# Tests, files and public items that the documents on the inside name.
code = "\n".join(text for name, text in texts.items() if name.endswith((".rs", ".py", ".ts")))
rust = {folder.name: "".join(text for name, text in texts.items() if name.startswith(f"crates/{folder.name}/src/"))
        for folder in (ROOT / "crates").iterdir()}
for name in ("ARCHITECTURE.md", "CONVENTIONS.md", "docs/method.md"):
    for quoted in re.findall(r"`([^`\n]+)`", re.sub(r"^```.*?^```", "", texts[name], flags=re.M | re.S)):
        last = quoted.split("::")[-1]
        crate, _, item = quoted.partition("::")
        if (ROOT / "crates" / crate).is_dir() and re.fullmatch(r"\w+(::\w+)*", item) and not re.search(rf"\b{last}\b", rust[crate]):
            faults.append(f"{name}: there is no {quoted}")
        if re.fullmatch(r"(crates|docs|python|\.ci)/[\w./-]+", quoted):
            if not (ROOT / quoted).exists():
                faults.append(f"{name}: there is no {quoted}")
        elif re.fullmatch(r"[a-z0-9]+(_[a-z0-9]+){3,}", last) and f"fn {last}" not in code and f"def {last}" not in code:
            faults.append(f"{name}: there is no test {quoted}")

# The map of crates is drawn without the arrows that others imply.
packages = json.loads(subprocess.run(["cargo", "metadata", "--no-deps", "--offline", "--format-version", "1"], cwd=ROOT, capture_output=True,
                                     text=True, check=True).stdout)["packages"]
short = {package["name"]: package["name"].removeprefix("mavsight-") for package in packages}
true = {short[p["name"]]: {short[d["name"]] for d in p["dependencies"] if d["kind"] is None and d["name"] in short} for p in packages}
drawn = {}
for source, targets in re.findall(r"^ +(\w+) --> (\w+(?: & \w+)*)$", texts["ARCHITECTURE.md"], re.M):
    drawn.setdefault(source, set()).update(targets.split(" & "))


def reached(graph, source):
    return set().union(*({target} | reached(graph, target) for target in graph.get(source, ())))


for crate in sorted(true):
    if reached(true, crate) != reached(drawn, crate):
        missing, surplus = reached(true, crate) - reached(drawn, crate), reached(drawn, crate) - reached(true, crate)
        faults.append(f"ARCHITECTURE.md: {crate} reaches {sorted(missing)} too" if missing else f"ARCHITECTURE.md: {crate} does not reach {sorted(surplus)}")
    implied = {target for other in true[crate] for target in reached(true, other)}
    for target in sorted(drawn.get(crate, set()) & implied):
        faults.append(f"ARCHITECTURE.md: the arrow {crate} --> {target} is implied by others")

print(*faults, *words[:40], f"{len(faults)} faults and {len(words)} words to replace in {len(texts)} texts", sep="\n")
raise SystemExit(bool(faults or words))
