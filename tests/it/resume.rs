//! Builds that are killed, stopped, or fail part of the way, and are resumed: the same bytes as
//! those of one that ran through.

#![cfg(unix)]

use std::fs;
use std::os::unix::process::ExitStatusExt;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Output, Stdio};
use std::time::{Duration, Instant};

use relevo::geo::Geo;
use relevo::geotiff_write::{Compression, GeotiffSpec, GeotiffWriter};
use relevo::sample::SampleType;
use relevo::source::Samples;
use relevo::work_folder::Mark;
use tempfile::TempDir;

/// A folder with a DEM in it, and the file that an undisturbed build makes of it.
struct Case {
    folder: TempDir,
    expected: Vec<u8>,
    /// How long that took.
    time: Duration,
}

const TILE: [&str; 4] = ["--tile", "64", "--patch", "16"];

impl Case {
    fn new(side: u32, compression: Compression) -> Self {
        let folder = tempfile::tempdir().expect("folder");
        dem(&folder.path().join("dem.tif"), side, compression);
        let mut case = Self { folder, expected: Vec::new(), time: Duration::ZERO };
        let start = Instant::now();
        let built = case.command(&[]).output().expect("the binary runs");
        assert!(built.status.success(), "{}", stderr(&built));
        case.time = start.elapsed();
        case.expected = fs::read(case.out()).expect("built");
        fs::remove_file(case.out()).expect("remove");
        case
    }

    fn dem(&self) -> PathBuf {
        self.folder.path().join("dem.tif")
    }

    fn out(&self) -> PathBuf {
        self.folder.path().join("out.rlv")
    }

    fn work(&self) -> PathBuf {
        self.folder.path().join("out.rlv.work")
    }

    /// A build that makes a checkpoint as often as it can.
    fn command(&self, more: &[&str]) -> Command {
        let mut command = Command::new(env!("CARGO_BIN_EXE_relevo"));
        command.arg("build").arg(self.dem()).arg("-o").arg(self.out()).args(TILE);
        command.args(["--progress", "none", "--checkpoint", "0"]).args(more);
        command.stdout(Stdio::null()).stderr(Stdio::piped());
        command
    }

    fn spawn(&self, more: &[&str]) -> Child {
        self.command(more).spawn().expect("the binary runs")
    }

    /// A build that has made its first checkpoint and is stopped in the middle of its work.
    fn begun(&self) -> Child {
        for _ in 0..20 {
            let mut child = self.spawn(&[]);
            while !self.work().join("state").exists() && child.try_wait().expect("wait").is_none() {
                std::thread::sleep(Duration::from_millis(1));
            }
            signal(&child, "STOP");
            // On a machine that was busy elsewhere it may have come to its end meanwhile.
            if child.try_wait().expect("wait").is_none() && !self.out().exists() && self.tiles_kept() > 0 {
                return child;
            }
            let _ = child.kill();
            child.wait().expect("wait");
            let _ = fs::remove_file(self.out());
            let _ = fs::remove_dir_all(self.work());
        }
        panic!("no build could be stopped between its first checkpoint and its end");
    }

    /// A build that is killed after its first checkpoint.
    fn killed(&self) {
        let mut child = self.begun();
        child.kill().expect("kill");
        let status = child.wait().expect("wait");
        assert_eq!(status.signal(), Some(9));
        assert!(!self.out().exists());
    }

    /// Tiles that a resumed build need not make again.
    fn tiles_kept(&self) -> u64 {
        let Ok(state) = fs::read(self.work().join("state")) else {
            return 0;
        };
        // A state begins with its mark.
        wincode::deserialize::<Mark>(&state[20..]).expect("a whole state").tiles
    }

    /// Resumes, and compares.
    fn resumes(&self) {
        let resumed = self.command(&["--resume"]).output().expect("the binary runs");
        assert!(resumed.status.success(), "{}", stderr(&resumed));
        self.is_whole();
        fs::remove_file(self.out()).expect("remove");
    }

    fn is_whole(&self) {
        assert!(
            fs::read(self.out()).expect("built") == self.expected,
            "other bytes than an undisturbed build"
        );
        assert!(!self.work().exists());
    }
}

/// Hills of noise with voids: a few seconds of work.
fn dem(path: &Path, side: u32, compression: Compression) {
    let geo = Geo { transform: Some([500_000.0, 30.0, 0.0, 5_000_000.0, 0.0, -30.0]), ..Geo::default() };
    let mut spec = GeotiffSpec::new(side, side, SampleType::Int16, &geo);
    spec.nodata = Some(-32768.0);
    spec.compression = compression;
    let mut writer = GeotiffWriter::create(path, &spec).expect("create");
    let mut random = 1_u32;
    for y in 0..side {
        let row = (0..side).map(|x| {
            random = random.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            let lake = (x / 50 * 7 + y / 40 * 13) % 11 == 0 && random >> 30 != 0;
            let height = f64::from(x) * 0.013;
            let hill = 700.0 * height.sin() * (f64::from(y) * 0.009).cos() + f64::from(random >> 26);
            if lake { -32768 } else { hill as i16 }
        });
        writer.write_rows(&Samples::Int16(row.collect())).expect("write");
    }
    writer.finish().expect("finish");
}

fn signal(child: &Child, name: &str) {
    let mut kill = Command::new("kill");
    kill.args([&format!("-{name}"), &child.id().to_string()]).stderr(Stdio::null());
    kill.status().expect("kill runs");
}

fn stderr(output: &Output) -> String {
    String::from_utf8_lossy(&output.stderr).into_owned()
}

/// Exit code 2 and one line with all of `words`.
fn fails(output: &Output, words: &[&str]) {
    let message = stderr(output);
    assert_eq!(output.status.code(), Some(2), "{message}");
    assert_eq!(message.trim_end().lines().count(), 1, "{message}");
    for word in words {
        assert!(message.contains(word), "{word:?} is not in {message:?}");
    }
}

#[test]
fn killed_at_fifty_random_moments() {
    let case = Case::new(1500, Compression::None);
    let mut random = u64::from(std::process::id()) | 1;
    let (mut kills, mut kept, mut tiles) = (0, 0, 0);
    while kills < 50 {
        let mut child = case.spawn(&["--resume"]);
        random = random.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        std::thread::sleep(case.time.mul_f64((random >> 40) as f64 / f64::from(1 << 24)));
        child.kill().expect("kill");
        let output = child.wait_with_output().expect("wait");
        let status = output.status;
        kills += usize::from(status.signal() == Some(9));
        if case.out().exists() {
            // Ended, or killed between the rename and its end: whole in any case.
            assert!(fs::read(case.out()).expect("built") == case.expected);
            fs::remove_file(case.out()).expect("remove");
            tiles = 0;
        } else {
            assert_eq!(status.signal(), Some(9), "{}", stderr(&output));
            let now = case.tiles_kept();
            assert!(now >= tiles, "{now} tiles were kept after {tiles}");
            kept += usize::from(now > tiles);
            tiles = now;
        }
    }
    case.resumes();
    assert!(kept >= 5, "only {kept} of {kills} killed builds had come farther than the one before");
}

#[test]
fn strips_are_resumed_too() {
    let case = Case::new(1500, Compression::None);
    // A strip of a few of the 24 columns of tiles at a time.
    let limit = ["--jobs", "2", "--memory", "36MiB"];
    for _ in 0..4 {
        let mut child = case.spawn(&[&limit[..], &["--resume"]].concat());
        std::thread::sleep(case.time.mul_f64(0.4));
        let _ = child.kill();
        let output = child.wait_with_output().expect("wait");
        if case.out().exists() {
            // Ended, or killed between the rename and its end.
            assert!(fs::read(case.out()).expect("built") == case.expected);
            fs::remove_file(case.out()).expect("remove");
        } else {
            assert_eq!(output.status.signal(), Some(9), "{}", stderr(&output));
            assert!(case.work().join("strip-000").exists() || case.work().join("strip-000.work").exists());
        }
    }
    case.resumes();
}

#[test]
fn changed_options_and_inputs_are_refused() {
    let case = Case::new(1200, Compression::None);
    case.killed();
    let refused = case.spawn(&[]).wait_with_output().expect("ends");
    fails(&refused, &["out.rlv.work", "unfinished build", "--resume", "--force"]);
    // What such a message says to do is all of it: no second advice.
    assert!(!stderr(&refused).contains("what is done is kept"), "{}", stderr(&refused));
    let mut other = case.command(&["--resume"]);
    other.args(["--nodata", "-1"]);
    fails(&other.output().expect("runs"), &["--nodata was not given, now it is -1", "--force"]);
    let other = case.command(&["--resume", "--precision", "5"]).output().expect("runs");
    fails(&other, &["--precision", "--force"]);
    let other = case.command(&["--resume", "--jobs", "2", "--memory", "32MiB"]).output().expect("runs");
    fails(&other, &["--memory", "begun with more", "--force"]);
    let other = case.command(&["--resume", "--window", "0,0,3,3"]).output().expect("runs");
    fails(&other, &["window", "--force"]);
    case.resumes();

    case.killed();
    let time = fs::metadata(case.dem()).expect("metadata").modified().expect("time");
    let file = fs::OpenOptions::new().write(true).open(case.dem()).expect("open");
    file.set_modified(time + Duration::from_secs(2)).expect("touch");
    let refused = case.command(&["--resume"]).output().expect("runs");
    fails(&refused, &["the input has changed since", "dem.tif was written to", "--force"]);
    assert!(!stderr(&refused).contains("what is done is kept"), "{}", stderr(&refused));
    file.set_modified(time).expect("touch");
    case.resumes();

    case.killed();
    let anew = case.command(&["--force"]).output().expect("runs");
    assert!(anew.status.success(), "{}", stderr(&anew));
    case.is_whole();
}

#[test]
fn stopped_builds_go_on() {
    let case = Case::new(1200, Compression::None);
    for name in ["INT", "TERM"] {
        let child = case.begun();
        signal(&child, name);
        signal(&child, "CONT");
        let output = child.wait_with_output().expect("ends");
        fails(&output, &["interrupted", "out.rlv.work", "--resume"]);
        assert!(!case.out().exists());
        case.resumes();
    }
}

#[test]
fn two_builds_of_one_output() {
    let case = Case::new(1200, Compression::None);
    let mut first = case.begun();
    for more in [&["--resume"][..], &["--force"], &[]] {
        let second = case.command(more).output().expect("runs");
        fails(&second, &["another build is writing", "out.rlv"]);
    }
    signal(&first, "CONT");
    assert!(first.wait().expect("ends").success());
    case.is_whole();
}

/// Runs the build under a limit of the size of a file, which stands for a full disk: the system
/// call fails in the middle.
fn with_limit(case: &Case, blocks: u64, more: &str) -> Output {
    let script = format!(
        "trap '' XFSZ; ulimit -f {blocks}; exec '{}' build '{}' -o '{}' {} --progress none --checkpoint 0 {more}",
        env!("CARGO_BIN_EXE_relevo"),
        case.dem().display(),
        case.out().display(),
        TILE.join(" "),
    );
    Command::new("bash").args(["-c", &script]).output().expect("bash runs")
}

#[test]
fn a_full_disk_is_survived() {
    let case = Case::new(1200, Compression::None);
    let size = case.expected.len() as u64 / 1024;
    // In the middle of the tiles, and while the finished file is put together.
    for (blocks, more) in [(size / 3, ""), (size - 20, "--resume")] {
        let output = with_limit(&case, blocks, more);
        fails(&output, &["out.rlv", "File too large", "--resume"]);
        assert!(!case.out().exists() && case.work().join("state").exists());
    }
    case.resumes();
}

#[test]
fn the_input_is_damaged_or_goes_away_meanwhile() {
    let case = Case::new(1200, Compression::Zstd);
    let good = fs::read(case.dem()).expect("read");
    let time = fs::metadata(case.dem()).expect("metadata").modified().expect("time");
    let restore = || {
        fs::write(case.dem(), &good).expect("write");
        fs::OpenOptions::new().write(true).open(case.dem()).expect("open").set_modified(time).expect("touch");
    };
    // Damaged in the middle, from the start.
    let mut bad = good.clone();
    let middle = bad.len() * 2 / 3;
    bad[middle..middle + 2000].fill(0xA5);
    fs::write(case.dem(), &bad).expect("write");
    fs::OpenOptions::new().write(true).open(case.dem()).expect("open").set_modified(time).expect("touch");
    let output = case.command(&[]).output().expect("runs");
    fails(&output, &["dem.tif", "--resume"]);
    assert!(!case.out().exists());
    restore();
    case.resumes();
    // Cut short while it is being read, then gone: the build fails or had read it all; it never
    // crashes.
    for gone in [false, true] {
        let child = case.begun();
        if gone {
            fs::remove_file(case.dem()).expect("remove");
        } else {
            let file = fs::OpenOptions::new().write(true).open(case.dem()).expect("open");
            file.set_len(good.len() as u64 / 2).expect("cut");
        }
        signal(&child, "CONT");
        let output = child.wait_with_output().expect("ends");
        if output.status.success() {
            // Stopped when it had read all.
            assert!(fs::read(case.out()).expect("built") == case.expected);
            fs::remove_file(case.out()).expect("remove");
        } else {
            fails(&output, &["dem.tif"]);
            assert!(!case.out().exists() && case.work().exists());
        }
        restore();
        case.resumes();
    }
}

#[test]
fn the_folder_of_the_output_goes_away() {
    let case = Case::new(1200, Compression::None);
    let child = case.begun();
    let away = case.folder.path().join("elsewhere");
    fs::rename(case.work(), &away).expect("move");
    signal(&child, "CONT");
    let output = child.wait_with_output().expect("ends");
    fails(&output, &["out.rlv"]);
    assert!(!case.out().exists());
    // Nothing was lost: back in its place it can be resumed.
    fs::rename(&away, case.work()).expect("move back");
    case.resumes();
}
