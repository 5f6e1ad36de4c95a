//! `relevo-viewer`.

fn main() {}
