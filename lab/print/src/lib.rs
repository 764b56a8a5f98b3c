#![doc = include_str!("../README.md")]
#![forbid(unsafe_code)]

use std::sync::{Arc, OnceLock};

use resvg::tiny_skia::{Pixmap, Transform};
use resvg::usvg::{self, Options, Tree, fontdb};
use softrig_formats::error::InputError;
use softrig_report::plot::{Printer, install as make_known};

/// Makes PDF and PNG known to everything in this program that draws.
pub fn install() {
    make_known(&Print);
}

/// Fonts without serifs, the first of which a machine has is taken. The first three are what the
/// drawing asks for; all have the Greek letters and signs of a label.
const FONTS: [&str; 9] = [
    "Helvetica",
    "Arial",
    "Liberation Sans",
    "Arimo",
    "Helvetica Neue",
    "Nimbus Sans",
    "DejaVu Sans",
    "Noto Sans",
    "Segoe UI",
];

/// Pixels of an inch in SVG.
const PX_PER_INCH: f32 = 96.0;

const METRES_PER_INCH: f64 = 0.0254;

/// More pixels across than any printer needs, and still no gigabytes.
const MOST_PIXELS: u32 = 20_000;

struct Print;

impl Printer for Print {
    fn pdf(&self, svg: &str) -> Result<Vec<u8>, InputError> {
        let page = svg2pdf::PageOptions { dpi: PX_PER_INCH };
        let options = svg2pdf::ConversionOptions::default();
        svg2pdf::to_pdf(&tree(svg)?, options, page).map_err(|error| defect(&error.to_string()))
    }

    fn png(&self, svg: &str, width_px: u32, dots_per_inch: f64) -> Result<Vec<u8>, InputError> {
        let tree = tree(svg)?;
        let size = tree.size();
        let height = f64::from(width_px) * f64::from(size.height() / size.width());
        if width_px > MOST_PIXELS || height > f64::from(MOST_PIXELS) {
            return Err(InputError::new(
                format!("would be {width_px} by {height:.0} pixels"),
                format!("ask for at most {MOST_PIXELS} with --width, or write .pdf"),
            ));
        }
        #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss)] // checked above
        let height_px = height.round().max(1.0) as u32;
        let mut pixels = Pixmap::new(width_px, height_px).ok_or_else(|| defect("no pixels"))?;
        #[allow(clippy::cast_precision_loss)] // far below 2^24
        let [across, down] = [
            width_px as f32 / size.width(),
            height_px as f32 / size.height(),
        ];
        resvg::render(
            &tree,
            Transform::from_scale(across, down),
            &mut pixels.as_mut(),
        );
        encoded(&pixels, dots_per_inch).map_err(|error| defect(&error.to_string()))
    }
}

/// The pixels as a PNG that says how large it is on paper.
fn encoded(pixels: &Pixmap, dots_per_inch: f64) -> Result<Vec<u8>, png::EncodingError> {
    let mut bytes = Vec::new();
    let mut encoder = png::Encoder::new(&mut bytes, pixels.width(), pixels.height());
    encoder.set_color(png::ColorType::Rgb);
    encoder.set_depth(png::BitDepth::Eight);
    encoder.set_compression(png::Compression::Best);
    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss)] // a few thousand
    let per_metre = (dots_per_inch / METRES_PER_INCH).round() as u32;
    encoder.set_pixel_dims(Some(png::PixelDimensions {
        xppu: per_metre,
        yppu: per_metre,
        unit: png::Unit::Meter,
    }));
    // The drawing has a white ground: nothing is translucent.
    let colours: Vec<u8> = pixels
        .pixels()
        .iter()
        .flat_map(|it| [it.red(), it.green(), it.blue()])
        .collect();
    let mut writer = encoder.write_header()?;
    writer.write_image_data(&colours)?;
    writer.finish()?;
    Ok(bytes)
}

fn tree(svg: &str) -> Result<Tree, InputError> {
    let options = fonts().ok_or_else(|| {
        InputError::new(
            "cannot be written: this machine has no font for its labels",
            "install one, such as the package fonts-liberation, or write .svg",
        )
    })?;
    Tree::from_str(svg, options).map_err(|error| defect(&error.to_string()))
}

/// The fonts of this machine, looked for once; none if there is none to write with.
fn fonts() -> Option<&'static Options<'static>> {
    static FOUND: OnceLock<Option<Options<'static>>> = OnceLock::new();
    let found = FOUND.get_or_init(|| {
        let mut all = fontdb::Database::new();
        all.load_system_fonts();
        let has = |name: &str, all: &fontdb::Database| {
            let families = [fontdb::Family::Name(name)];
            let query = fontdb::Query {
                families: &families,
                ..fontdb::Query::default()
            };
            all.query(&query).is_some()
        };
        let known = FONTS.iter().find(|name| has(name, &all));
        let any = || Some(all.faces().next()?.families.first()?.0.clone());
        let family = known.map(|it| (*it).to_owned()).or_else(any)?;
        all.set_sans_serif_family(&family);
        Some(usvg::Options {
            font_family: family,
            fontdb: Arc::new(all),
            ..usvg::Options::default()
        })
    });
    found.as_ref()
}

/// An error that no input of a user leads to.
fn defect(what: &str) -> InputError {
    InputError::new(
        format!("cannot be written: {what}"),
        "write .svg, and report this as a defect of softrig",
    )
}
