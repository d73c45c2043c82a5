//! `--scale`: known lengths between two pixels of a photograph.

use std::str::FromStr;

use glam::DVec2;

use super::values::within;

/// How a known length is written.
const FORM: &str = "write PICTURE:(x,y)-(x,y)=LENGTH, e.g. IMG_1.jpg:(120,340)-(510,352)=12cm, in m, cm, mm, in or ft";

/// Units of length, in metres; those that end as another does come first.
const UNITS: [(&str, f64); 5] = [("mm", 1e-3), ("cm", 1e-2), ("m", 1.0), ("in", 0.0254), ("ft", 0.3048)];

/// Two pixels of a picture's file, and how far apart the points of the object are that they show.
#[derive(Clone, Debug, PartialEq)]
pub struct KnownLengthArg {
    /// As it was written.
    pub text: String,
    /// The picture: the name of its view or of its file, with or without the ending.
    pub picture: String,
    /// The middles of the pixels, from the top left corner of the file's picture.
    pub pixels: [DVec2; 2],
    /// The length in metres.
    pub metres: f64,
}

/// What scales the mesh of a run.
#[derive(Clone, Debug, PartialEq)]
pub enum ScaleArg {
    /// Nothing.
    Off,
    /// A known length.
    Length(KnownLengthArg),
}

impl FromStr for KnownLengthArg {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let form = || FORM.to_owned();
        // Names of files may hold anything.
        let (rest, length) = text.rsplit_once('=').ok_or_else(form)?;
        let (picture, pixels) = rest.rsplit_once(":(").filter(|(picture, _)| !picture.is_empty()).ok_or_else(form)?;
        let (first, second) = pixels.trim_end().strip_suffix(')').and_then(|p| p.split_once(")-(")).ok_or_else(form)?;
        let pixel = |text: &str| {
            let (x, y) = text.split_once(',').ok_or_else(form)?;
            let place = |text: &str| {
                let text = text.trim();
                within(0.0, 1e6)(text).map_err(|wrong| format!("pixel coordinate {text:?}: {wrong}"))
            };
            Ok::<_, String>(DVec2::new(place(x)?, place(y)?) + 0.5)
        };
        let pixels = [pixel(first)?, pixel(second)?];
        if pixels[0] == pixels[1] {
            return Err("both pixels are the same, and nothing lies between them".into());
        }
        let length = length.trim();
        let unit = UNITS.iter().find_map(|(name, metres)| Some((length.strip_suffix(name)?.trim_end(), metres)));
        let (number, unit) = unit.ok_or_else(|| format!("length {length:?} has no unit: {FORM}"))?;
        let number: f64 =
            within(1e-6, 1e6)(number).map_err(|wrong| format!("length {length:?}: {wrong} with its unit"))?;
        Ok(Self { text: text.to_owned(), picture: picture.to_owned(), pixels, metres: number * unit })
    }
}

impl FromStr for ScaleArg {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        if text == "off" { Ok(Self::Off) } else { text.parse().map(Self::Length) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn parsed(text: &str) -> Result<KnownLengthArg, String> {
        text.parse()
    }

    #[test]
    fn pixels_and_lengths_are_read_in_every_unit() {
        let length = parsed("a:(b=1).jpg:(3,4)-(10.5, 0)=12.5 cm").unwrap();
        assert_eq!((length.picture.as_str(), length.metres), ("a:(b=1).jpg", 0.125));
        assert_eq!(length.pixels, [DVec2::new(3.5, 4.5), DVec2::new(11.0, 0.5)]);
        for (text, metres) in [("2m", 2.0), ("250mm", 0.25), ("10in", 0.254), ("1ft", 0.3048), ("1e2cm", 1.0)] {
            assert!((parsed(&format!("a:(1,2)-(3,4)={text}")).unwrap().metres - metres).abs() < 1e-12, "{text}");
        }
        assert_eq!("off".parse(), Ok(ScaleArg::Off));
    }

    #[test]
    fn what_is_wrong_is_told() {
        for (text, part) in [
            ("", "PICTURE:(x,y)-(x,y)=LENGTH"),
            ("a:(1,2)-(3,4)", "PICTURE:(x,y)-(x,y)=LENGTH"),
            (":(1,2)-(3,4)=1m", "PICTURE"),
            ("a:(1,2)=1m", "PICTURE"),
            ("a:(1,2)-(3)=1m", "PICTURE"),
            ("a:(1,2)-(3,x)=1m", "pixel coordinate \"x\": write a number from 0 to 1000000"),
            ("a:(-1,2)-(3,4)=1m", "pixel coordinate \"-1\""),
            ("a:(1,2)-(1,2)=1m", "the same"),
            ("a:(1,2)-(3,4)=1", "no unit"),
            ("a:(1,2)-(3,4)=1km", "write a number from 0.000001 to 1000000"),
            ("a:(1,2)-(3,4)=0m", "length \"0m\": write a number from 0.000001 to 1000000"),
            ("a:(1,2)-(3,4)=-2m", "length \"-2m\""),
            ("a:(1,2)-(3,4)=infm", "length \"infm\""),
            ("a:(1,2)-(3,4)=NaNm", "length \"NaNm\""),
        ] {
            let wrong = parsed(text).unwrap_err();
            assert!(wrong.contains(part), "{text}: {wrong}");
        }
    }
}
