//! The loader thread: reads and decodes the tiles that the views need, the most urgent first.
//!
//! It runs the same selection as the drawing thread, on the tiles that it has delivered
//! ([`crate::known`]). So it goes down the tree without being asked tile by tile, each after its
//! parent; once the current view has all tiles, it goes on with the view predicted for 0.5 seconds
//! ahead. The drawing thread sends it the tiles that it has dropped. The two threads share channels
//! only.

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

/// Most deliveries that wait for the drawing thread: a bound on decoded tiles between the threads.
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

/// A request for all tiles of some views.
#[derive(Clone, Debug)]
pub struct Request {
    /// Number of the request; [`Delivery::Settled`] has the same.
    pub serial: u64,
    /// The current view, then the predicted one if there is one.
    pub views: Vec<View>,
    /// The frame of the views.
    pub frame: Frame,
    /// Options of the selection.
    pub options: Options,
    /// Most pixels that a texel may cover.
    pub magnification: f64,
}

/// A message to the loader.
#[derive(Clone, Debug)]
pub(crate) enum Message {
    /// A request in place of the one before.
    Request(Box<Request>),
    /// Tiles that are no longer resident.
    Gone(Vec<Item>),
    /// A tile for which there was no slot: it is not delivered again for the same request.
    Refused(Item),
}

/// A decoded tile of heights.
#[derive(Clone, Debug)]
pub struct LoadedTile {
    /// The part that selection reads.
    pub table: Arc<TileTable>,
    /// The part that is uploaded.
    pub data: Arc<TileData>,
    /// Rows of its children, by quadrant.
    pub children: [Option<Node>; 4],
    /// True if only the predicted view wants it.
    pub ahead: bool,
}

/// A decoded image.
#[derive(Clone, Debug)]
pub struct LoadedImage {
    /// Its id.
    pub id: TileId,
    /// Its texels, gutters included.
    pub texels: Arc<Texels>,
    /// Bits of the children of its children, by quadrant.
    pub children: [Option<u8>; 4],
    /// True if only the predicted view wants it.
    pub ahead: bool,
}

/// A message from the loader.
#[derive(Clone, Debug)]
pub enum Delivery {
    /// Heights.
    Tile(LoadedTile),
    /// Imagery.
    Image(LoadedImage),
    /// A tile that cannot be read and will not be tried again, with the reason.
    Bad(Item, String),
    /// All tiles that the current view of this request wants have been delivered, or cannot be.
    Settled(u64),
    /// Height of the ground under the eye, metres.
    Ground(f64),
}

/// The handle of the loader thread.
#[derive(Debug)]
pub struct Loader {
    // Both are dropped before the thread is joined: it ends when its channels are closed.
    ends: Option<(Sender<Message>, Receiver<Delivery>)>,
    thread: Option<JoinHandle<()>>,
}

impl Loader {
    /// Starts the thread. `ram_cache` bytes of decoded tiles are kept; `root` and `images` are the
    /// rows of the root tiles.
    pub fn start(reader: Arc<Reader>, ram_cache: u64, root: Node, images: Option<u8>) -> Result<Self> {
        let (requests, messages) = mpsc::channel();
        let (out, deliveries) = mpsc::sync_channel(WAITING);
        let worker = Worker::new(reader, ram_cache, root, images, out);
        let thread = std::thread::Builder::new()
            .name("loader".into())
            .spawn(move || worker.run(&messages))
            .map_err(|error| Error::usage(format!("cannot start the loader thread: {error}")))?;
        Ok(Self { ends: Some((requests, deliveries)), thread: Some(thread) })
    }

    /// Sends a request in place of the one before.
    pub fn request(&self, request: Request) {
        self.send(Message::Request(Box::new(request)));
    }

    pub(crate) fn send(&self, message: Message) {
        if let Some((requests, _)) = &self.ends {
            // A loader that has ended delivers nothing more; resident tiles are still drawn.
            let _ = requests.send(message);
        }
    }

    /// Returns the next delivery, if there is one; does not wait.
    pub fn poll(&self) -> Option<Delivery> {
        self.ends.as_ref()?.1.try_recv().ok()
    }

    /// Waits for the next delivery and returns it. Fails if the thread is gone.
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
