//! What somebody finds in the files: text as text, the asked size, and refusals with a way out.

use std::io::Read;
use std::path::Path;

use flate2::read::ZlibDecoder;
use softrig_report::plot::{Figure, Length, Look, Panel, Series, Style, write};

fn figure() -> Figure {
    let time: Vec<f64> = (0..200).map(|i| f64::from(i) * 0.01).collect();
    let angle: Vec<f64> = time
        .iter()
        .map(|t| 60.0 * (1.0 - (-5.0 * t).exp()))
        .collect();
    let panel = |title: &str| {
        Panel::new("time (s)", "angle (°)")
            .with_title(title)
            .with_series(Series::new("measured", &time, &angle, Style::MEASURED))
            .with_series(Series::new("zugzwang", &time, &angle, Style::AFTER))
    };
    Figure::new("A headline with a Q")
        .with_columns(2)
        .with_panel(panel("first"))
        .with_panel(panel("second"))
}

/// The bytes of the figure in a file of this name.
fn written(name: &str, look: &Look) -> Vec<u8> {
    softrig_print::install();
    let folder = std::env::temp_dir().join(format!("softrig-print-{}", std::process::id()));
    std::fs::create_dir_all(&folder).unwrap();
    let path = folder.join(name);
    write(&path, &figure(), look).unwrap();
    std::fs::read(&path).unwrap()
}

fn wide(width: &str) -> Look {
    Look {
        width: Some(width.parse::<Length>().unwrap()),
        ..Look::default()
    }
}

/// The unpacked streams of a PDF, one after the other.
fn streams(pdf: &[u8]) -> String {
    let starts = pdf
        .windows(7)
        .enumerate()
        .filter(|(_, it)| it == b"stream\n");
    // Some are not packed, such as the tables of letters.
    let mut text = String::from_utf8_lossy(pdf).into_owned();
    for (at, _) in starts {
        let mut unpacked = Vec::new();
        // Some are no text, such as the font itself.
        let _ = ZlibDecoder::new(&pdf[at + 7..]).read_to_end(&mut unpacked);
        text += &String::from_utf8_lossy(&unpacked);
    }
    // Letters stand there by their numbers, in capitals or not.
    text.to_lowercase()
}

/// Width and height of the page (pt).
fn media_box(pdf: &[u8]) -> [f64; 2] {
    let text = String::from_utf8_lossy(pdf);
    let from = text.find("/MediaBox [0 0 ").unwrap() + "/MediaBox [0 0 ".len();
    let numbers = text[from..].split(']').next().unwrap();
    let mut numbers = numbers.split(' ').map(|it| it.parse().unwrap());
    [numbers.next().unwrap(), numbers.next().unwrap()]
}

#[test]
fn a_pdf_has_text_as_text_and_the_asked_width() {
    let pdf = written("text.pdf", &wide("89mm"));
    let [width, _] = media_box(&pdf);
    assert!((width - 89.0 / 25.4 * 72.0).abs() < 0.05, "{width} pt");
    let raw = String::from_utf8_lossy(&pdf);
    assert!(
        raw.contains("/ToUnicode") && raw.contains("/FontFile"),
        "fonts"
    );
    let text = streams(&pdf);
    assert!(text.contains(" tj"), "text is drawn as text");
    // The letters that stand in it can be searched for and copied.
    for letter in "zugangle°measured".chars() {
        let code = format!("<{:04x}>", u32::from(letter));
        assert!(
            text.contains(&code),
            "{letter} is not in the table of letters"
        );
    }
    // There is no heading unless it is asked for.
    let headline = format!("<{:04x}>", u32::from('Q'));
    assert!(!text.contains(&headline), "a headline");
    let look = Look {
        headline: Some(true),
        ..wide("89mm")
    };
    assert!(streams(&written("headline.pdf", &look)).contains(&headline));
}

#[test]
fn a_png_has_the_asked_pixels_and_says_its_size() {
    let size = |png: &[u8]| {
        let number = |at: usize| u32::from_be_bytes(png[at..at + 4].try_into().unwrap());
        [number(16), number(20)]
    };
    let png = written("screen.png", &wide("800px"));
    assert!(png.starts_with(b"\x89PNG"));
    assert_eq!(size(&png)[0], 800);
    // 89 mm with 300 dots an inch, which is 11811 a metre.
    let png = written("paper.png", &wide("89mm"));
    assert_eq!(size(&png)[0], 1051);
    let density = png.windows(4).position(|it| it == b"pHYs").unwrap() + 4;
    assert_eq!(png[density..density + 4], 11811_u32.to_be_bytes());
}

#[test]
fn narrow_pictures_put_their_panels_one_below_the_other() {
    let [_, beside] = media_box(&written("wide.pdf", &wide("180mm")));
    let [_, below] = media_box(&written("narrow.pdf", &wide("80mm")));
    assert!(below > 1.3 * beside, "{below} pt, {beside} pt");
    let look = Look {
        panels: vec!["second".to_owned()],
        ..wide("80mm")
    };
    let [_, one] = media_box(&written("one.pdf", &look));
    assert!(one < 0.6 * below, "{one} pt, {below} pt");
}

#[test]
fn what_cannot_be_drawn_is_refused_with_a_way_out() {
    let refused = |name: &str, look: &Look| {
        write(Path::new(name), &figure(), look)
            .unwrap_err()
            .to_string()
    };
    for name in ["fig.jpg", "fig.eps", "fig"] {
        let error = refused(name, &Look::default());
        assert!(error.contains(".svg, .pdf or .png"), "{error}");
        assert!(!Path::new(name).exists());
    }
    let error = refused("fig.svg", &wide("2cm"));
    assert!(
        error.contains("too narrow") && error.contains("--font-size"),
        "{error}"
    );
    let look = Look {
        panels: vec!["torque".to_owned()],
        ..Look::default()
    };
    let error = refused("fig.svg", &look);
    assert!(
        error.contains("torque") && error.contains("1 angle (°), first"),
        "{error}"
    );
    for length in ["89", "0mm", "-3in", "mm", "nanmm"] {
        assert!(length.parse::<Length>().is_err(), "{length}");
    }
}
