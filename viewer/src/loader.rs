//! The loader thread: reads and decodes what the views need, the most urgent first, and hands it over decoded.
//!
//! It runs the same selection as the drawing thread, on what it has delivered ([`crate::known`]): so it goes down the tree
//! by itself, a tile after its parent, and answers the view of 0.5 seconds ahead once the current one has all it wants.
//! The drawing thread says what it has dropped. Channels are all they share.

mod worker;

use std::sync::Arc;
use std::sync::mpsc::{self, Receiver, Sender};
use std::thread::JoinHandle;

use relevo_core::container::Reader;
use relevo_core::select::tile::{Node, TileData, TileTable};
use relevo_core::select::{Frame, Options, View};
use relevo_core::texel::Texels;
use relevo_core::{Error, Result, TileId};

use worker::Worker;

/// Deliveries that may wait for the drawing thread: a bound on decoded tiles between the threads.
const WAITING: usize = 32;
/// Seconds that the loader looks ahead.
pub const AHEAD: f64 = 0.5;

/// A tile of heights or of imagery.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Item {
    /// Heights.
    Tile(TileId),
    /// Imagery.
    Image(TileId),
}

/// What is to be seen.
#[derive(Clone, Debug)]
pub struct Ask {
    /// Number of the question; [`Delivery::Settled`] answers with it.
    pub serial: u64,
    /// The current view, then the predicted one if there is one.
    pub views: Vec<View>,
    /// Where things stand.
    pub frame: Frame,
    /// What is asked of the selection.
    pub options: Options,
    /// Pixels that a texel may cover.
    pub magnification: f64,
}

/// To the loader.
#[derive(Clone, Debug)]
pub(crate) enum Message {
    /// Look at this; what was asked before is forgotten.
    Ask(Box<Ask>),
    /// These are no longer resident.
    Gone(Vec<Item>),
    /// There was no slot for it: not again while the question is the same.
    Refused(Item),
}

/// A decoded tile of heights.
#[derive(Clone, Debug)]
pub struct LoadedTile {
    /// What selection needs.
    pub table: Arc<TileTable>,
    /// What the GPU needs.
    pub data: Arc<TileData>,
    /// Rows of its children, by quadrant.
    pub children: [Option<Node>; 4],
    /// The current view does not want it, the predicted one does.
    pub ahead: bool,
}

/// A decoded image.
#[derive(Clone, Debug)]
pub struct LoadedImage {
    /// Which.
    pub id: TileId,
    /// Its texels, gutters included.
    pub texels: Arc<Texels>,
    /// Bits of the children of its children, by quadrant.
    pub children: [Option<u8>; 4],
    /// As of a tile of heights.
    pub ahead: bool,
}

/// From the loader.
#[derive(Clone, Debug)]
pub enum Delivery {
    /// Heights.
    Tile(LoadedTile),
    /// Imagery.
    Image(LoadedImage),
    /// It cannot be read and will not be asked for again; why, in words.
    Bad(Item, String),
    /// All that the current view of this question wants has been delivered, or cannot be.
    Settled(u64),
    /// Height of the ground under the eye, metres.
    Ground(f64),
}

/// The thread, from the other side.
#[derive(Debug)]
pub struct Loader {
    // Both are gone before the thread is waited for: it ends when nobody talks to it.
    ends: Option<(Sender<Message>, Receiver<Delivery>)>,
    thread: Option<JoinHandle<()>>,
}

impl Loader {
    /// Starts the thread. `ram_cache` bytes of decoded tiles are kept; `root` and `images` are the rows of the root tiles.
    pub fn start(reader: Arc<Reader>, ram_cache: u64, root: Node, images: Option<u8>) -> Result<Self> {
        let (asks, questions) = mpsc::channel();
        let (answers, deliveries) = mpsc::sync_channel(WAITING);
        let worker = Worker::new(reader, ram_cache, root, images, answers);
        let thread = std::thread::Builder::new()
            .name("loader".into())
            .spawn(move || worker.run(&questions))
            .map_err(|error| Error::usage(format!("cannot start the loader thread: {error}")))?;
        Ok(Self { ends: Some((asks, deliveries)), thread: Some(thread) })
    }

    /// A question in place of the one before.
    pub fn ask(&self, ask: Ask) {
        self.send(Message::Ask(Box::new(ask)));
    }

    pub(crate) fn send(&self, message: Message) {
        if let Some((asks, _)) = &self.ends {
            // A loader that is gone delivers nothing more; what is resident goes on to be drawn.
            let _ = asks.send(message);
        }
    }

    /// What has come, without waiting.
    pub fn poll(&self) -> Option<Delivery> {
        self.ends.as_ref()?.1.try_recv().ok()
    }

    /// The next delivery. Fails if the thread is gone.
    pub fn wait(&self) -> Result<Delivery> {
        let got = self.ends.as_ref().and_then(|(_, deliveries)| deliveries.recv().ok());
        got.ok_or_else(|| Error::usage("the loader thread has ended unexpectedly"))
    }
}

impl Drop for Loader {
    fn drop(&mut self) {
        self.ends = None;
        if let Some(thread) = self.thread.take() {
            let _ = thread.join();
        }
    }
}
