//! Who may import whom: the table of ARCHITECTURE.md, held against `cargo metadata`.
//!
//! A broken arrow is a red test, not a review comment.

#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic, reason = "a test may fail loudly")]

use std::collections::BTreeMap;

use cargo_metadata::{DependencyKind, MetadataCommand};

/// Workspace crates that each crate may name among its dependencies.
const MAY_IMPORT: &[(&str, &[&str])] = &[
    ("heedway-geometry", &[]),
    ("heedway-mapping", &["heedway-geometry"]),
    ("heedway-rules", &["heedway-geometry"]),
    ("heedway-utterance", &["heedway-geometry", "heedway-rules"]),
    ("heedway-control", &["heedway-geometry", "heedway-mapping", "heedway-rules"]),
    ("heedway-envelope", &["heedway-geometry"]),
    ("heedway-proto", &["heedway-geometry", "heedway-rules"]),
    ("heedway-service", &["heedway-geometry", "heedway-proto"]),
    ("heedway-robot", &["heedway-envelope", "heedway-geometry", "heedway-proto", "heedway-service"]),
];

/// What services may import beside the contract and the runtime: kernels. `heedway` carries them all.
const KERNELS: &[&str] =
    &["heedway-geometry", "heedway-mapping", "heedway-rules", "heedway-utterance", "heedway-control"];
const CONTRACT_AND_RUNTIME: &[&str] = &["heedway-proto", "heedway-service", "heedway-robot"];

/// Crates of the outside world that decide nothing and must not reach a kernel.
const BANNED_IN_KERNELS: &[&str] =
    &["tokio", "zenoh", "tracing", "reqwest", "ort", "redb", "anyhow", "tracing-subscriber"];

struct Crate {
    folder: String,
    dependencies: Vec<String>,
}

fn workspace() -> BTreeMap<String, Crate> {
    let metadata = MetadataCommand::new().no_deps().exec().unwrap();
    let root = metadata.workspace_root.clone();
    let normal = |p: &cargo_metadata::Package| {
        p.dependencies
            .iter()
            .filter(|d| d.kind != DependencyKind::Development)
            .map(|d| d.name.clone())
            .collect()
    };
    metadata
        .packages
        .iter()
        .map(|p| {
            let folder = p.manifest_path.parent().unwrap().strip_prefix(&root).unwrap().to_string();
            (p.name.to_string(), Crate { folder, dependencies: normal(p) })
        })
        .collect()
}

fn is_ours(name: &str, all: &BTreeMap<String, Crate>) -> bool {
    all.contains_key(name)
}

#[test]
fn every_arrow_between_crates_is_in_the_table() {
    let all = workspace();
    for (name, krate) in &all {
        let allowed: Vec<&str> = if let Some((_, allowed)) = MAY_IMPORT.iter().find(|(n, _)| n == name) {
            allowed.to_vec()
        } else if krate.folder == "services/heedway" {
            all.keys()
                .filter(|n| {
                    all[*n].folder.starts_with("services/")
                        || KERNELS.contains(&n.as_str())
                        || CONTRACT_AND_RUNTIME.contains(&n.as_str())
                })
                .map(String::as_str)
                .collect()
        } else if krate.folder.starts_with("services/") {
            KERNELS.iter().chain(CONTRACT_AND_RUNTIME).copied().collect()
        } else if krate.folder.starts_with("tests/") {
            all.keys().map(String::as_str).collect()
        } else {
            panic!("{name} in {} has no row in the table", krate.folder);
        };
        for dependency in krate.dependencies.iter().filter(|d| is_ours(d, &all)) {
            assert!(allowed.contains(&dependency.as_str()), "{name} must not import {dependency}");
        }
    }
}

#[test]
fn no_kernel_touches_the_world() {
    for (name, krate) in workspace().iter().filter(|(_, k)| k.folder.starts_with("kernels/")) {
        for dependency in &krate.dependencies {
            assert!(!BANNED_IN_KERNELS.contains(&dependency.as_str()), "{name} must not import {dependency}");
        }
    }
}

#[test]
fn nobody_imports_the_tests() {
    let all = workspace();
    for (name, krate) in &all {
        for dependency in &krate.dependencies {
            let is_test = all.get(dependency).is_some_and(|k| k.folder.starts_with("tests/"));
            assert!(!is_test || krate.folder.starts_with("tests/"), "{name} must not import {dependency}");
        }
    }
}
