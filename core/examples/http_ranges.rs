//! Reads a `.rlv` file from a server that knows ranges, and asks it for a height: no more is loaded
//! than that takes.
//!
//! `cargo run -p relevo-core --example http_ranges -- http://localhost:8000/dem.rlv 441000 4471000`

use std::io::{self, Read};

use relevo_core::{ReadAt, Reader, ReaderOptions, surface};

/// A file on a server.
struct Remote {
    agent: ureq::Agent,
    url: String,
    bytes: u64,
}

impl ReadAt for Remote {
    fn byte_count(&self) -> io::Result<u64> {
        Ok(self.bytes)
    }

    fn read_exact_at(&self, bytes: &mut [u8], offset: u64) -> io::Result<()> {
        let range = format!("bytes={offset}-{}", offset + bytes.len() as u64 - 1);
        let answer = self.agent.get(&self.url).header("Range", range).call().map_err(io::Error::other)?;
        if answer.status() != 206 {
            return Err(io::Error::other("the server does not know ranges"));
        }
        answer.into_body().into_reader().read_exact(bytes)
    }
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [url, x, y] = &arguments[..] else { return Err("usage: http_ranges URL X Y".into()) };
    let agent = ureq::Agent::new_with_defaults();
    let length =
        agent.head(url).call()?.headers().get("Content-Length").ok_or("no length")?.to_str()?.parse()?;
    let file = Remote { agent, url: url.clone(), bytes: length };
    let reader = Reader::new(file, url, ReaderOptions::default())?;
    match surface::height_at(&reader, x.parse()?, y.parse()?)? {
        Some(height) => println!("{height:.3} m"),
        None => println!("void, or outside"),
    }
    Ok(())
}
