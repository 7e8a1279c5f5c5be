//! The rooms of `src`, and which of them may use which: the imports against the table of `docs/design/rooms.md`, and no circles between files.
//!
//! An import is a `use`, or a path that begins with `crate` or `super` in the code. Names are followed through `pub use` to the file that
//! defines them. What a file of modules hands on is no import, nor is code for tests.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

/// The table as long as the page is not there.
const TABLE: &str = "\
| `parallel` | | nothing |
| `leb128` | | nothing |
| `random` | | nothing |
| `page` | | nothing |
| `mesh` | | nothing |
| `image` | | `mesh`, `leb128` |
| `format` | | `mesh`, `image`, `parallel`, `leb128` |
| `io` | | `mesh`, `image`, `random` |
| `samples` | | `mesh`, `random` |
| `quality` | | `mesh`, `image`, `format`, `parallel` |
| `encode` | | `mesh`, `image`, `format`, `quality`, `parallel`, `random` |
| `gpu` | | `mesh`, `format`, `encode`, `parallel` |
| `ingest` | | `mesh`, `image`, `format`, `io`, `quality`, `encode`, `parallel`, `page` |
| `bin` | | the library's public face |
";

/// Circles that stand until somebody mends them: files that begin so may know each other.
const STANDING: [&[&str]; 2] = [
    &["io/read/gltf/buffer.rs", "io/read/gltf/meshopt.rs"],
    &["io/read/attribute.rs", "io/read/build.rs", "io/read/weld.rs", "io/read/mod.rs"],
];

/// A module of a crate: the names from the root.
type Path_ = Vec<String>;

struct File {
    /// Where it lies below `src`.
    name: String,
    code: String,
    /// Names that it hands on or imports, and what they stand for.
    bound: BTreeMap<String, Path_>,
    globs: Vec<Path_>,
    /// What it imports.
    imports: Vec<Path_>,
}

struct Crate {
    files: BTreeMap<Path_, File>,
}

fn source() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("src")
}

/// The files of a folder, with their modules.
fn walk(folder: &Path, module: &Path_, out: &mut Vec<(Path_, PathBuf)>) {
    let mut entries: Vec<PathBuf> = std::fs::read_dir(folder).unwrap().map(|e| e.unwrap().path()).collect();
    entries.sort();
    for path in entries {
        let stem = path.file_stem().unwrap().to_string_lossy().into_owned();
        if stem == "tests" || (module.is_empty() && stem == "bin") {
            continue;
        }
        let mut inner = module.clone();
        if path.is_dir() {
            inner.push(stem);
            walk(&path, &inner, out);
        } else if path.extension().is_some_and(|e| e == "rs") {
            if !["mod", "lib", "main"].contains(&stem.as_str()) {
                inner.push(stem);
            }
            out.push((inner, path));
        }
    }
}

/// Code without comments, strings and what is for tests.
fn bare(text: &str) -> String {
    let mut out = String::new();
    let mut rest = text;
    while let Some(c) = rest.chars().next() {
        let skip = if rest.starts_with("//") {
            rest.find('\n').unwrap_or(rest.len())
        } else if rest.starts_with("r#\"") {
            rest.find("\"#").map_or(rest.len(), |end| end + 2)
        } else if rest.starts_with("'\"'") || rest.starts_with("'{'") || rest.starts_with("'}'") {
            3
        } else if c == '"' {
            let mut escaped = false;
            let end = rest[1..].find(|c| {
                let end = c == '"' && !escaped;
                escaped = c == '\\' && !escaped;
                end
            });
            end.map_or(rest.len(), |end| end + 2)
        } else {
            out.push(c);
            c.len_utf8()
        };
        rest = &rest[skip..];
    }
    while let Some(at) = out.find("#[cfg(test)]").or_else(|| out.find("#[cfg(all(test")) {
        // Up to the end of the item: a semicolon, or the brace that closes it.
        let (mut depth, mut end) = (0, out.len());
        for (i, c) in out[at..].char_indices() {
            depth += i32::from(c == '{') - i32::from(c == '}');
            if depth == 0 && (c == ';' || c == '}') {
                end = at + i + 1;
                break;
            }
        }
        out.replace_range(at..end, "");
    }
    out
}

/// The paths of a tree of imports, each with the name that it binds.
fn paths(tree: &str, before: &[String], out: &mut Vec<(Path_, String)>) {
    let tree = tree.trim();
    let head = tree.split_once('{');
    if let Some((head, inner)) = head.filter(|(head, _)| !head.contains(',')) {
        let mut before = before.to_vec();
        before.extend(head.split("::").map(str::trim).filter(|s| !s.is_empty()).map(str::to_string));
        let inner = &inner[..inner.rfind('}').unwrap_or(inner.len())];
        let (mut depth, mut from) = (0, 0);
        for (i, c) in inner.char_indices().chain([(inner.len(), ',')]) {
            depth += i32::from(c == '{') - i32::from(c == '}');
            if c == ',' && depth == 0 {
                if !inner[from..i].trim().is_empty() {
                    paths(&inner[from..i], &before, out);
                }
                from = i + 1;
            }
        }
        return;
    }
    let (path, name) = tree.split_once(" as ").map_or((tree, None), |(path, name)| (path, Some(name.trim())));
    let mut all = before.to_vec();
    all.extend(path.split("::").map(|s| s.trim().to_string()));
    if all.last().is_some_and(|last| last == "self") {
        all.pop();
    }
    let name = name.map(str::to_string).or_else(|| all.last().cloned()).unwrap_or_default();
    out.push((all, name));
}

impl Crate {
    fn read(root: &Path) -> Crate {
        let mut list = Vec::new();
        walk(root, &Vec::new(), &mut list);
        let modules: BTreeSet<Path_> = list.iter().map(|(module, _)| module.clone()).collect();
        let files = list.into_iter().map(|(module, path)| {
            let code = bare(&std::fs::read_to_string(&path).unwrap());
            let name = path.strip_prefix(source()).unwrap().display().to_string();
            let mut file = File { name, code, bound: BTreeMap::new(), globs: Vec::new(), imports: Vec::new() };
            file.scan(&module, &modules);
            (module, file)
        });
        Crate { files: files.collect() }
    }

    /// The module that defines what a path from the root names.
    fn resolve(&self, path: &[String], steps: u32) -> Option<&Path_> {
        let length = (0..=path.len()).rev().find(|&n| self.files.contains_key(&path[..n]))?;
        let (module, file) = self.files.get_key_value(&path[..length])?;
        let Some(name) = path.get(length) else { return Some(module) };
        if steps == 0 || file.defines(name) {
            return Some(module);
        }
        if let Some(bound) = file.bound.get(name) {
            let longer: Path_ = bound.iter().chain(&path[length + 1..]).cloned().collect();
            return self.resolve(&longer, steps - 1);
        }
        let from_globs = file.globs.iter().filter_map(|glob| {
            let longer: Path_ = glob.iter().chain(&path[length..]).cloned().collect();
            self.resolve(&longer, steps - 1).filter(|found| self.files[*found].defines(name))
        });
        Some(from_globs.into_iter().next().unwrap_or(module))
    }

    /// Which files each file imports, by name. A file and the files of its folder are one: what a child takes of its parents is not told.
    fn arrows(&self) -> BTreeMap<&str, BTreeSet<&str>> {
        let arrows = self.files.iter().map(|(own, file)| {
            let to = file.imports.iter().filter_map(|path| self.resolve(path, 8));
            let to = to.filter(|target| !(own.starts_with(target)));
            let to = to.map(|module| self.files[module].name.as_str()).filter(|name| *name != file.name);
            (file.name.as_str(), to.collect())
        });
        arrows.collect()
    }
}

impl File {
    fn defines(&self, name: &str) -> bool {
        ["fn", "struct", "enum", "trait", "type", "const", "static", "union", "macro_rules!"].iter().any(|kind| {
            let item = format!("{kind} {name}");
            self.code
                .match_indices(&item)
                .any(|(at, _)| !self.code[at + item.len()..].starts_with(|c: char| c.is_alphanumeric() || c == '_'))
        })
    }

    /// Find the imports of a file that is `module`.
    fn scan(&mut self, module: &Path_, modules: &BTreeSet<Path_>) {
        // From the root, if it is a path of this crate.
        let absolute = |path: &[String]| -> Option<Path_> {
            let mut base = match path.first()?.as_str() {
                "crate" => return Some(path[1..].to_vec()),
                "self" | "super" => module.clone(),
                first => {
                    let child: Path_ = module.iter().cloned().chain([first.to_string()]).collect();
                    return modules.contains(&child).then(|| module.iter().chain(path).cloned().collect());
                }
            };
            let ups = path.iter().take_while(|s| *s == "super").count();
            base.truncate(base.len().saturating_sub(ups));
            base.extend(path.iter().skip_while(|s| *s == "super" || *s == "self").cloned());
            Some(base)
        };
        let code = std::mem::take(&mut self.code);
        let mut others = String::new();
        for statement in code.split_inclusive([';', '}']) {
            // A list in braces ends with the semicolon behind it.
            others.push_str(statement);
        }
        let mut rest = others.as_str();
        let mut outside = String::new();
        while let Some(at) = rest.find("use ") {
            let starts = rest[..at].chars().next_back().is_none_or(|c| c.is_whitespace());
            let end = rest[at..].find(';').map_or(rest.len(), |end| at + end);
            if !starts {
                outside.push_str(&rest[..at + 4]);
                rest = &rest[at + 4..];
                continue;
            }
            let line = rest[..at].rfind('\n').map_or(0, |n| n + 1);
            let public = rest[line..at].contains("pub");
            let mut found = Vec::new();
            paths(&rest[at + 4..end], &[], &mut found);
            for (path, name) in found {
                let Some(path) = absolute(&path) else { continue };
                if name == "*" {
                    let glob = path[..path.len() - 1].to_vec();
                    if public {
                        self.globs.push(glob);
                    } else {
                        self.imports.push(glob);
                    }
                } else {
                    if !public {
                        self.imports.push(path.clone());
                    }
                    self.bound.insert(name, path);
                }
            }
            outside.push_str(&rest[..at]);
            rest = &rest[end..];
        }
        outside.push_str(rest);
        // Paths in the code itself.
        let letters = |c: char| c.is_alphanumeric() || c == '_';
        for start in ["crate::", "super::"] {
            for (at, _) in outside.match_indices(start) {
                if outside[..at].ends_with(|c: char| letters(c) || c == ':' || c == '$' || c == '(')
                    && !outside[..at].ends_with('(')
                    || outside[..at].ends_with("in ")
                {
                    continue;
                }
                let path: Path_ = outside[at..]
                    .split("::")
                    .scan(true, |go, part| {
                        let word: String = part.chars().take_while(|&c| letters(c)).collect();
                        let this = *go && !word.is_empty();
                        *go = this && word.len() == part.len();
                        this.then_some(word)
                    })
                    .collect();
                self.imports.extend(absolute(&path));
            }
        }
        self.code = code;
    }
}

/// What each room may use, by the table.
fn table() -> BTreeMap<String, BTreeSet<String>> {
    let page = Path::new(env!("CARGO_MANIFEST_DIR")).join("docs/design/rooms.md");
    let text = std::fs::read_to_string(page).unwrap_or_else(|_| TABLE.to_string());
    let mut rooms = BTreeMap::new();
    for line in text.lines().filter(|line| line.starts_with("| `")) {
        let cells: Vec<&str> = line.trim_matches('|').split('|').collect();
        let names = |cell: &str| cell.split('`').skip(1).step_by(2).map(str::to_string).collect::<Vec<_>>();
        let uses: BTreeSet<String> = names(cells[cells.len() - 1]).into_iter().collect();
        names(cells[0]).into_iter().for_each(|room| {
            rooms.insert(room, uses.clone());
        });
    }
    rooms
}

/// The room of a file.
fn room(name: &str) -> &str {
    let first = name.split('/').next().unwrap_or(name);
    first.strip_suffix(".rs").unwrap_or(first)
}

/// Files that reach each other, in groups.
fn circles(arrows: &BTreeMap<&str, BTreeSet<&str>>) -> Vec<BTreeSet<String>> {
    let reach = |from: &str| {
        let (mut seen, mut stack) = (BTreeSet::new(), vec![from.to_string()]);
        while let Some(file) = stack.pop() {
            for &to in arrows.get(file.as_str()).into_iter().flatten() {
                if seen.insert(to.to_string()) {
                    stack.push(to.to_string());
                }
            }
        }
        seen
    };
    let all: BTreeMap<&str, BTreeSet<String>> = arrows.keys().map(|&file| (file, reach(file))).collect();
    let mut found: Vec<BTreeSet<String>> = Vec::new();
    for (file, to) in &all {
        if to.contains(*file) && !found.iter().any(|circle| circle.contains(*file)) {
            found.push(to.iter().filter(|other| all[other.as_str()].contains(*file)).cloned().collect());
        }
    }
    found
}

#[test]
fn rooms_use_what_the_table_allows() {
    let library = Crate::read(&source());
    let allowed = table();
    let mut seen = BTreeSet::new();
    let mut wrong = Vec::new();
    for (from, targets) in library.arrows() {
        if from == "lib.rs" {
            continue;
        }
        seen.insert(room(from).to_string());
        let Some(may) = allowed.get(room(from)) else {
            wrong.push(format!("{from}: the table has no room `{}`", room(from)));
            continue;
        };
        for to in targets {
            if room(to) != room(from) && !may.contains(room(to)) {
                wrong.push(format!("{from} uses {to}, and `{}` may not use `{}`", room(from), room(to)));
            }
        }
    }
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
    seen.insert("bin".to_string());
    let gone: Vec<&String> = allowed.keys().filter(|room| !seen.contains(*room)).collect();
    assert!(gone.is_empty(), "rooms of the table that are not there: {gone:?}");
    // Lower rooms never import upper ones: the table itself has no circle.
    let rooms = allowed.iter().map(|(room, may)| (room.as_str(), may.iter().map(String::as_str).collect())).collect();
    assert_eq!(circles(&rooms), Vec::<BTreeSet<String>>::new());
}

#[test]
fn files_do_not_know_each_other_in_circles() {
    let mut found = Vec::new();
    for root in [source(), source().join("bin/lodestream")] {
        let all = Crate::read(&root);
        let arrows = all.arrows();
        found.extend(circles(&arrows).into_iter().map(|circle| {
            let inner = |file: &String| {
                let to = arrows[file.as_str()].iter().filter(|to| circle.contains(**to));
                format!("  {file} -> {}", to.copied().collect::<Vec<_>>().join(", "))
            };
            (circle.clone(), circle.iter().map(inner).collect::<Vec<_>>().join("\n"))
        }));
    }
    let standing = |circle: &BTreeSet<String>| {
        STANDING.iter().any(|folders| circle.iter().all(|file| folders.iter().any(|folder| file.starts_with(folder))))
    };
    let told: Vec<&String> = found.iter().filter(|(circle, _)| !standing(circle)).map(|(_, text)| text).collect();
    assert!(
        told.is_empty(),
        "{} circles:\n{}",
        told.len(),
        told.iter().map(|t| t.as_str()).collect::<Vec<_>>().join("\n\n")
    );
}

#[test]
fn imports_are_read_as_rust_reads_them() {
    let mut found = Vec::new();
    paths("crate::{a::{self, B as C}, d::e::*, f}", &[], &mut found);
    let shown: Vec<String> = found.iter().map(|(path, name)| format!("{} {name}", path.join("::"))).collect();
    assert_eq!(shown, ["crate::a a", "crate::a::B C", "crate::d::e::* *", "crate::f f"]);
    let text = "use a; // use b;\nlet s = \"use c; \\\" {\";\n#[cfg(test)]\nmod tests { use d; fn f() {} }\nuse e;";
    assert_eq!(bare(text).split_whitespace().collect::<Vec<_>>(), ["use", "a;", "let", "s", "=", ";", "use", "e;"]);
}
