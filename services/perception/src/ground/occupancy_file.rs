//! Cells of a rule's region as a map that ROS map_server reads: a PGM image and its YAML.

use std::io::Write;
use std::path::Path;

use anyhow::Context;
use proto::CellSet;

/// How map_server's images show an occupied and a free cell.
const OCCUPIED: u8 = 0;
const FREE: u8 = 254;

/// Writes `NAME.pgm` and `NAME.yaml` into a folder; returns the names of both files.
///
/// # Errors
/// When a file cannot be written.
pub fn write(cells: &CellSet, folder: &Path, name: &str) -> anyhow::Result<(String, String)> {
    let layout = &cells.layout;
    let (image, text) = (format!("{name}.pgm"), format!("{name}.yaml"));
    let mut pgm = format!("P5\n{} {}\n255\n", layout.n_cols, layout.n_rows).into_bytes();
    let values = cells.unpack();
    // The first row of the image is the highest in the map.
    for row in values.chunks(layout.n_cols.max(1) as usize).rev() {
        pgm.extend(row.iter().map(|occupied| if *occupied { OCCUPIED } else { FREE }));
    }
    let write_all = |file: &str, bytes: &[u8]| {
        let path = folder.join(file);
        std::fs::File::create(&path)
            .and_then(|mut opened| opened.write_all(bytes))
            .with_context(|| path.display().to_string())
    };
    write_all(&image, &pgm)?;
    let yaml = format!(
        "image: {image}\nmode: trinary\nresolution: {}\norigin: [{}, {}, 0.0]\nnegate: 0\noccupied_thresh: 0.65\n\
         free_thresh: 0.196\n",
        layout.resolution_m, layout.origin_map.x, layout.origin_map.y
    );
    write_all(&text, yaml.as_bytes())?;
    Ok((image, text))
}
