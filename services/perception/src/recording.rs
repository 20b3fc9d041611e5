//! Recorded RGB-D on disk, in two layouts, checked as it is read.
//!
//! *Seven scenes*: `frame-NNNNNN.color.jpg` (or `.png`), `.depth.png` (16 bit, millimetres), `.pose.txt`
//! (camera to world, 4×4) and one `camera-intrinsics.txt` (3×3). *Numbered*: `color_N.png`, `depth_N.pgm`
//! (16 bit, millimetres) and one `pose.txt`, a line `tx ty tz qx qy qz qw` for each frame, camera to world;
//! its intrinsics are those the layout is published with, unless the folder holds `camera-intrinsics.txt`.
//! Depth is registered to colour. 0 and 65535 are no depth; both come out as 0.
//!
//! Frames are read one at a time. A frame whose pose is missing or impossible is an error that names it, so
//! that the caller can leave it out and say so. Deliberately not here: what a frame shows.

use std::fs::File;
use std::io::Read;
use std::path::{Path, PathBuf};

use anyhow::{Context, bail, ensure};
use geometry::{CameraIntrinsics, Pose3};

mod pixels;
mod poses;
#[cfg(test)]
mod tests;

/// Largest file that is read, bytes: an uncompressed image of 8 megapixels.
const N_BYTES_MAX: u64 = 64 * 1024 * 1024;
/// Name of the file with the camera's matrix.
const INTRINSICS_FILE: &str = "camera-intrinsics.txt";
/// Focal lengths and principal point, pixels, that the numbered layout is published with (a Kinect at 640×480).
const NUMBERED_CAMERA: [f64; 4] = [518.0, 519.0, 325.5, 253.5];

/// How files are named.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Naming {
    /// `frame-NNNNNN.depth.png` and its companions.
    SevenScenes,
    /// `depth_N.pgm` and its companions.
    Numbered,
}

/// A folder of recorded RGB-D.
#[derive(Clone, Debug)]
pub struct Recording {
    folder: PathBuf,
    naming: Naming,
    intrinsics: CameraIntrinsics,
    /// Numbers of the frames, ascending.
    numbers: Vec<u32>,
    /// Lines of `pose.txt`, of the numbered layout only.
    pose_lines: Vec<String>,
}

/// Depth and where it was taken.
#[derive(Clone, Debug)]
pub struct RecordedDepth {
    /// Number of the frame.
    pub number: u32,
    /// Row-major, of the size that the intrinsics say, millimetres, 0 where there is none.
    pub depth_mm: Vec<u16>,
    /// Where the camera was, in the recording's own world; its axes are optical.
    pub world_from_camera: Pose3,
}

/// One frame.
#[derive(Clone, Debug)]
pub struct RecordedFrame {
    /// Depth and pose.
    pub depth: RecordedDepth,
    /// Red, green, blue, row-major, of the depth's size.
    pub rgb: Vec<u8>,
}

impl Recording {
    /// Opens a folder. `intrinsics`, when given, is taken instead of what the folder says.
    ///
    /// # Errors
    /// When it holds no frames of either layout, no intrinsics, or a first depth image that cannot be.
    pub fn open(folder: &Path, intrinsics: Option<CameraIntrinsics>) -> anyhow::Result<Self> {
        let (naming, numbers) = frames_in(folder)?;
        let Some(&first) = numbers.first() else {
            bail!("{}: neither `frame-NNNNNN.depth.png` nor `depth_N.pgm` is in it", folder.display());
        };
        let depth_file = file_of(folder, naming, first, Part::Depth);
        let (width, height, _) = pixels::depth_mm(&depth_file)?;
        let intrinsics = match intrinsics {
            Some(given) => given,
            None => intrinsics_in(folder, naming, width, height)?,
        };
        let intrinsics = intrinsics.checked().with_context(|| folder.display().to_string())?;
        ensure!(
            (width, height) == (intrinsics.width, intrinsics.height),
            "{}: {width}×{height} pixels, the intrinsics are of {}×{}",
            depth_file.display(),
            intrinsics.width,
            intrinsics.height
        );
        let pose_lines = match naming {
            Naming::SevenScenes => Vec::new(),
            Naming::Numbered if folder.join("pose.txt").exists() => text(&folder.join("pose.txt"))?
                .lines()
                .filter(|line| !line.trim().is_empty())
                .map(str::to_owned)
                .collect(),
            // Every pose is then missing, and each frame says so.
            Naming::Numbered => Vec::new(),
        };
        Ok(Recording { folder: folder.to_owned(), naming, intrinsics, numbers, pose_lines })
    }

    /// How its files are named.
    #[must_use]
    pub fn naming(&self) -> Naming {
        self.naming
    }

    /// The camera, of depth and colour alike.
    #[must_use]
    pub fn intrinsics(&self) -> &CameraIntrinsics {
        &self.intrinsics
    }

    /// Numbers of the frames, ascending.
    #[must_use]
    pub fn numbers(&self) -> &[u32] {
        &self.numbers
    }

    /// Reads depth and pose of one frame.
    ///
    /// # Errors
    /// Names the file and what is wrong with it.
    pub fn read_depth(&self, number: u32) -> anyhow::Result<RecordedDepth> {
        let file = self.file(number, Part::Depth);
        let (width, height, depth_mm) = pixels::depth_mm(&file)?;
        self.check_size(&file, width, height)?;
        Ok(RecordedDepth { number, depth_mm, world_from_camera: self.pose(number)? })
    }

    /// Reads one frame.
    ///
    /// # Errors
    /// Names the file and what is wrong with it.
    pub fn read(&self, number: u32) -> anyhow::Result<RecordedFrame> {
        let depth = self.read_depth(number)?;
        Ok(RecordedFrame { depth, rgb: self.rgb(number)? })
    }

    /// Reads depth and colour of one frame, wherever it was taken.
    ///
    /// # Errors
    /// Names the file and what is wrong with it.
    pub fn read_images(&self, number: u32) -> anyhow::Result<(Vec<u16>, Vec<u8>)> {
        let file = self.file(number, Part::Depth);
        let (width, height, depth_mm) = pixels::depth_mm(&file)?;
        self.check_size(&file, width, height)?;
        Ok((depth_mm, self.rgb(number)?))
    }

    fn rgb(&self, number: u32) -> anyhow::Result<Vec<u8>> {
        let mut file = self.file(number, Part::Colour);
        if !file.exists() {
            file.set_extension("png");
        }
        let (width, height, rgb) = pixels::rgb(&file)?;
        self.check_size(&file, width, height)?;
        Ok(rgb)
    }

    /// Where the camera was when a frame was taken, in the recording's own world.
    ///
    /// # Errors
    /// When its pose is missing or impossible; names the file.
    pub fn pose(&self, number: u32) -> anyhow::Result<Pose3> {
        match self.naming {
            Naming::SevenScenes => {
                let file = self.file(number, Part::Pose);
                poses::from_matrix(&text(&file)?).with_context(|| file.display().to_string())
            }
            Naming::Numbered => {
                let place = || format!("{}: pose of frame {number}", self.folder.join("pose.txt").display());
                let position = self.numbers.iter().position(|n| *n == number);
                let line = position.and_then(|idx| self.pose_lines.get(idx));
                let line = line.with_context(|| format!("{} is missing", place()))?;
                poses::from_quaternion_line(line).with_context(place)
            }
        }
    }

    fn file(&self, number: u32, part: Part) -> PathBuf {
        file_of(&self.folder, self.naming, number, part)
    }

    fn check_size(&self, file: &Path, width: u32, height: u32) -> anyhow::Result<()> {
        let wanted = (self.intrinsics.width, self.intrinsics.height);
        let shown = file.display();
        ensure!(
            (width, height) == wanted,
            "{shown}: {width}×{height} pixels, must be {}×{}",
            wanted.0,
            wanted.1
        );
        Ok(())
    }
}

/// A file of a frame.
#[derive(Clone, Copy)]
enum Part {
    Colour,
    Depth,
    Pose,
}

fn file_of(folder: &Path, naming: Naming, number: u32, part: Part) -> PathBuf {
    folder.join(match (naming, part) {
        (Naming::SevenScenes, Part::Colour) => format!("frame-{number:06}.color.jpg"),
        (Naming::SevenScenes, Part::Depth) => format!("frame-{number:06}.depth.png"),
        (Naming::SevenScenes, Part::Pose) => format!("frame-{number:06}.pose.txt"),
        (Naming::Numbered, Part::Colour) => format!("color_{number}.png"),
        (Naming::Numbered, Part::Depth) => format!("depth_{number}.pgm"),
        (Naming::Numbered, Part::Pose) => "pose.txt".to_owned(),
    })
}

/// The frames of a folder by their depth images, in whichever layout there are more of.
fn frames_in(folder: &Path) -> anyhow::Result<(Naming, Vec<u32>)> {
    let (mut scenes, mut numbered) = (Vec::new(), Vec::new());
    let entries = std::fs::read_dir(folder).with_context(|| folder.display().to_string())?;
    for entry in entries {
        let name = entry.with_context(|| folder.display().to_string())?.file_name();
        let name = name.to_string_lossy();
        let between = |start: &str, end: &str| {
            name.strip_prefix(start)
                .and_then(|rest| rest.strip_suffix(end))
                .and_then(|n| n.parse::<u32>().ok())
        };
        scenes.extend(between("frame-", ".depth.png"));
        numbered.extend(between("depth_", ".pgm"));
    }
    scenes.sort_unstable();
    numbered.sort_unstable();
    Ok(if scenes.len() >= numbered.len() {
        (Naming::SevenScenes, scenes)
    } else {
        (Naming::Numbered, numbered)
    })
}

fn intrinsics_in(folder: &Path, naming: Naming, width: u32, height: u32) -> anyhow::Result<CameraIntrinsics> {
    let file = folder.join(INTRINSICS_FILE);
    let [fx, fy, cx, cy] = if file.exists() {
        poses::camera_matrix(&text(&file)?).with_context(|| file.display().to_string())?
    } else if naming == Naming::Numbered && (width, height) == (640, 480) {
        NUMBERED_CAMERA
    } else {
        bail!("{}: no intrinsics; `{INTRINSICS_FILE}` is missing", folder.display());
    };
    Ok(CameraIntrinsics { width, height, fx, fy, cx, cy })
}

/// The bytes of a file that is not too large.
fn bytes(file: &Path) -> anyhow::Result<Vec<u8>> {
    let shown = || file.display().to_string();
    let mut found = Vec::new();
    File::open(file)
        .and_then(|opened| opened.take(N_BYTES_MAX + 1).read_to_end(&mut found))
        .with_context(shown)?;
    ensure!(found.len() as u64 <= N_BYTES_MAX, "{}: more than {N_BYTES_MAX} bytes", shown());
    Ok(found)
}

fn text(file: &Path) -> anyhow::Result<String> {
    String::from_utf8(bytes(file)?).with_context(|| file.display().to_string())
}
