//! Inside the rooms of ARCHITECTURE.md: no two files need each other, no two types have one name,
//! and files and functions are short.

#[path = "common/source.rs"]
mod source;

use source::{code, sources, without_tests};
use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::Path;

/// Most lines of a file, tests apart, and of a function.
const MOST_LINES: [usize; 2] = [400, 60];

/// `["sfm", "bundle"]` for `sfm/bundle.rs`.
type Module = Vec<String>;

/// A file without comments and tests.
struct Source {
    file: String,
    code: String,
    /// Lines with comments.
    lines: usize,
    /// What it takes, as paths from the root, under which name, and whether it hands it on.
    uses: Vec<(Vec<String>, String, bool)>,
}

/// Files that hold `mod` lines count; what they hand on they do not need themselves.
#[test]
fn no_circle_of_files() {
    no_circle(library());
    no_circle(sources_of("../dsfms-cli/src"));
}

fn no_circle(library: BTreeMap<Module, Source>) {
    let needs: BTreeMap<&Module, BTreeSet<&Module>> =
        library.iter().map(|(module, source)| (module, needs(&library, module, source))).collect();
    let mut circles: Vec<Vec<&str>> = Vec::new();
    let mut seen = BTreeSet::new();
    let all: BTreeMap<&Module, BTreeSet<&Module>> =
        needs.keys().map(|&module| (module, reached(&needs, module))).collect();
    for (module, reached) in &all {
        if seen.contains(module) || !reached.contains(module) {
            continue;
        }
        let circle: Vec<&Module> =
            reached.iter().copied().filter(|other| all[other].contains(module)).collect();
        seen.extend(circle.iter().copied());
        circles.push(circle.iter().map(|module| library[*module].file.as_str()).collect());
    }
    assert!(circles.is_empty(), "files that need each other:\n{circles:#?}");
}

/// All that a file needs, by whatever way.
fn reached<'a>(
    needs: &BTreeMap<&'a Module, BTreeSet<&'a Module>>,
    from: &'a Module,
) -> BTreeSet<&'a Module> {
    let (mut reached, mut open) = (BTreeSet::new(), vec![from]);
    while let Some(next) = open.pop() {
        open.extend(needs[next].iter().filter(|to| reached.insert(**to)));
    }
    reached
}

/// In the library, and in the command line.
#[test]
fn names_of_types_are_unique() {
    unique_names(library());
    unique_names(sources_of("../dsfms-cli/src"));
}

fn unique_names(sources: BTreeMap<Module, Source>) {
    let mut places: BTreeMap<String, Vec<String>> = BTreeMap::new();
    for source in sources.into_values() {
        for line in source.code.lines() {
            let words: Vec<&str> = line.split(|c: char| !c.is_alphanumeric() && c != '_').collect();
            let kind = ["struct", "enum", "trait", "type"];
            let named = words.windows(2).find(|pair| kind.contains(&pair[0])).map(|pair| pair[1]);
            // What stands within another item is its own matter.
            if let Some(name) = named.filter(|name| !line.starts_with(' ') && !name.is_empty()) {
                places.entry(name.to_string()).or_default().push(source.file.clone());
            }
        }
    }
    places.retain(|_, files| files.len() > 1);
    assert!(places.is_empty(), "names of several types:\n{places:#?}");
}

#[test]
fn tests_are_left_out_and_what_follows_is_read() {
    let text = "use a;\n#[cfg(test)]\n#[allow(x)]\nfn b(c: &'static str) -> [u8; 2] {\n    \"}\"; '{'; r#\"\"}\"#;\n    \
        // }\n}\nfn d() {}\n#[cfg(test)]\nmod e;\n    /* { */ \"#[cfg(test)]\"\n#[cfg(all(test, unix))]\nmod f {\n    \
        use g;\n}\nfn h() {}\n";
    let kept = without_tests(text);
    assert_eq!(kept, "use a;\n\nfn d() {}\n\n    /* { */ \"#[cfg(test)]\"\n\nfn h() {}\n");
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("src");
    let read = sources(&root);
    let is_read = |file: &str| read.contains(&root.join(file));
    assert!(is_read("track/shapes.rs") && is_read("energy/check.rs") && is_read("light/mod.rs"));
    assert!(!is_read("mesh/shapes.rs") && !is_read("light/check.rs") && !is_read("dense/tests.rs"));
}

#[test]
fn files_and_functions_are_short() {
    let mut long = Vec::new();
    let command_line = sources_of("../dsfms-cli/src").into_values();
    let python = sources_of("../dsfms-python/src").into_values();
    for Source { file, code, lines, .. } in
        library().into_values().chain(command_line).chain(python)
    {
        if lines > MOST_LINES[0] {
            long.push(format!("{file}: {lines} lines"));
        }
        let lines: Vec<&str> = code.lines().collect();
        for (first, line) in lines.iter().enumerate() {
            let indent = &line[..line.len() - line.trim_start().len()];
            let Some((before, named)) = line.trim_start().split_once("fn ") else { continue };
            if !before
                .split(' ')
                .all(|word| word.is_empty() || word.starts_with("pub") || word == "const")
            {
                continue;
            }
            let end = format!("{indent}}}");
            let length = lines[first..].iter().position(|line| **line == end).map_or(1, |n| n + 1);
            // A function of one line has no such end.
            if length > MOST_LINES[1] && !line.ends_with('}') && !line.ends_with(';') {
                long.push(format!(
                    "{file}: {} has {length} lines",
                    named.split('(').next().unwrap()
                ));
            }
        }
    }
    assert!(long.is_empty(), "{long:#?}");
}

/// The files that one takes something from, whoever hands it on.
fn needs<'a>(
    library: &'a BTreeMap<Module, Source>,
    own: &Module,
    source: &Source,
) -> BTreeSet<&'a Module> {
    let taken = source.uses.iter().filter(|(_, _, handed_on)| !handed_on);
    let found = taken.filter_map(|(path, _, _)| defining(library, path, 8));
    found.filter(|other| *other != own).collect()
}

/// The file in which the item of a path stands.
fn defining<'a>(
    library: &'a BTreeMap<Module, Source>,
    path: &[String],
    steps: usize,
) -> Option<&'a Module> {
    let length = (0..=path.len()).rev().find(|&k| library.contains_key(&path[..k]))?;
    let (module, source) = library.get_key_value(&path[..length])?;
    let handed_on = path.get(length).and_then(|name| {
        source.uses.iter().find(|(_, alias, handed_on)| *handed_on && alias == name)
    });
    match handed_on {
        Some((from, ..)) if steps > 0 => {
            let longer = [from, &path[length + 1..]].concat();
            defining(library, &longer, steps - 1)
        }
        _ => Some(module),
    }
}

fn library() -> BTreeMap<Module, Source> {
    sources_of("src")
}

fn sources_of(folder: &str) -> BTreeMap<Module, Source> {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join(folder);
    let mut library = BTreeMap::new();
    for path in sources(&root) {
        let file = path.strip_prefix(&root).unwrap().to_string_lossy().replace('\\', "/");
        let mut module: Module =
            file.trim_end_matches(".rs").split('/').map(String::from).collect();
        if ["mod", "lib", "main"].contains(&module.last().unwrap().as_str()) {
            module.pop();
        }
        let text = fs::read_to_string(&path).unwrap();
        let lines = without_tests(&text).lines().count();
        let code = code(&text);
        library.insert(module, Source { file, code, lines, uses: Vec::new() });
    }
    let modules: BTreeSet<Module> = library.keys().cloned().collect();
    for (module, source) in &mut library {
        source.uses = uses(&source.code, module, &modules);
    }
    library
}

/// What a file takes, by its `use` lines and by paths within its code.
fn uses(
    code: &str,
    module: &Module,
    modules: &BTreeSet<Module>,
) -> Vec<(Vec<String>, String, bool)> {
    let mut found = Vec::new();
    for statement in code.split(';') {
        let Some(line) = statement.lines().position(|line| {
            let line = line.trim_start_matches("pub(crate) ").trim_start_matches("pub(super) ");
            line.trim_start_matches("pub ").starts_with("use ")
        }) else {
            let absolute = |path: Vec<String>| absolute(&path, module, modules);
            let inline = inline(statement).into_iter().filter_map(absolute);
            found.extend(inline.map(|path| (path, String::new(), false)));
            continue;
        };
        let text: String = statement.lines().skip(line).collect();
        let (head, tree) = text.split_once("use ").unwrap();
        for (path, alias) in branches(tree, &[]) {
            found.extend(
                absolute(&path, module, modules).map(|path| (path, alias, !head.is_empty())),
            );
        }
    }
    found
}

/// Paths that stand within code; that of a visibility takes nothing.
fn inline(code: &str) -> Vec<Vec<String>> {
    let mut parts = code.split("pub(in ");
    let first = parts.next().into_iter();
    let code: String =
        first.chain(parts.filter_map(|part| Some(part.split_once(')')?.1))).collect();
    let part = |c: char| c.is_alphanumeric() || "_:".contains(c);
    let words = code.split(|c: char| !part(c)).filter(|word| word.contains("::"));
    words
        .map(|word| word.split("::").filter(|name| !name.is_empty()).map(String::from).collect())
        .collect()
}

/// `a::{b, c as d}` as `a::b` named `b` and `a::c` named `d`.
fn branches(tree: &str, before: &[String]) -> Vec<(Vec<String>, String)> {
    let (head, inner) = match tree.split_once('{') {
        Some((head, rest)) => (head, Some(&rest[..rest.rfind('}').unwrap_or(rest.len())])),
        None => (tree, None),
    };
    let (head, renamed) = head.split_once(" as ").unwrap_or((head, ""));
    let words = head.split("::").map(str::trim).filter(|word| !word.is_empty() && *word != "self");
    let path: Vec<String> = before.iter().cloned().chain(words.map(String::from)).collect();
    let Some(inner) = inner else {
        let last = path.last().cloned().unwrap_or_default();
        let alias = if renamed.is_empty() { last } else { renamed.trim().into() };
        return vec![(path, alias)];
    };
    let (mut depth, mut items) = (0, vec![String::new()]);
    for c in inner.chars() {
        depth += i32::from(c == '{') - i32::from(c == '}');
        match c {
            ',' if depth == 0 => items.push(String::new()),
            _ => items.last_mut().unwrap().push(c),
        }
    }
    items
        .iter()
        .filter(|item| !item.trim().is_empty())
        .flat_map(|item| branches(item, &path))
        .collect()
}

/// From the root of the library; `None` of what lies outside.
fn absolute(path: &[String], module: &Module, modules: &BTreeSet<Module>) -> Option<Vec<String>> {
    let up = path.iter().take_while(|word| *word == "super").count();
    match path.first()?.as_str() {
        "crate" => Some(path[1..].to_vec()),
        "super" => Some([&module[..module.len() - up], &path[up..]].concat()),
        first => {
            let child: Module = module.iter().cloned().chain([first.to_string()]).collect();
            modules.contains(&child).then(|| [&module[..], path].concat())
        }
    }
}
