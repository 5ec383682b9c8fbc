//! Square markers of black and white modules that carry a number.

/// Numbered square markers of so many modules a side, each within a black border of one module.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct MarkerDictionary {
    side: usize,
    codes: Vec<u64>,
}

const DICTIONARIES: &str = include_str!("dictionaries.txt");
/// Modules that may be misread: any two markers differ in three or more.
const MISREAD: u32 = 1;

impl MarkerDictionary {
    /// What OpenCV calls so: `DICT_4X4_50`, `DICT_5X5_100`, `DICT_6X6_250` and those in between
    /// (Garrido-Jurado et al. 2014), or `DICT_APRILTAG_36h11` (Olson 2011); `None` for others.
    pub fn named(name: &str) -> Option<Self> {
        let lines = DICTIONARIES.lines().filter(|l| !l.starts_with('#'));
        lines.filter_map(|line| line.split_once(' ')).find_map(|(family, numbers)| {
            let count = match name.strip_prefix(family)? {
                "" if family.contains("APRILTAG") => None,
                _ if family.contains("APRILTAG") => return None,
                "_50" => Some(50),
                "_100" => Some(100),
                "_250" => Some(250),
                _ => return None,
            };
            let (side, codes) = numbers.split_once(' ')?;
            let mut codes: Vec<u64> =
                codes.split(' ').map(|c| u64::from_str_radix(c, 16)).collect::<Result<_, _>>().ok()?;
            codes.truncate(count.unwrap_or(codes.len()));
            Some(Self { side: side.parse().ok()?, codes })
        })
    }

    /// Modules along a side, without the border.
    pub fn side(&self) -> usize {
        self.side
    }

    /// Number of markers.
    pub fn count(&self) -> usize {
        self.codes.len()
    }

    /// Whether a module of a marker is white; those of its border and beyond are not.
    pub fn is_white(&self, marker: usize, column: usize, row: usize) -> bool {
        let n = self.side;
        let code = self.codes.get(marker).copied().unwrap_or(0);
        column < n && row < n && (code >> (n * n - 1 - row * n - column)) & 1 == 1
    }

    /// The marker whose modules these are, row by row with the first as the highest bit, and by how many
    /// quarters clockwise they must be turned to be those of the dictionary; `None` where no marker is as
    /// near as one misread module.
    pub(super) fn read(&self, mut modules: u64) -> Option<(usize, usize)> {
        for quarters in 0..4 {
            let same = |code: &u64| (code ^ modules).count_ones() <= MISREAD;
            if let Some(marker) = self.codes.iter().position(same) {
                return Some((marker, quarters));
            }
            modules = self.turned(modules);
        }
        None
    }

    /// Modules turned by a quarter clockwise.
    fn turned(&self, modules: u64) -> u64 {
        let n = self.side;
        let at = |row: usize, column: usize| (modules >> (n * n - 1 - row * n - column)) & 1;
        (0..n * n).fold(0, |all, k| (all << 1) | at(n - 1 - k % n, k / n))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn dictionaries_have_the_names_and_sizes_of_opencv() {
        for (name, side, count) in [
            ("DICT_4X4_50", 4, 50),
            ("DICT_5X5_100", 5, 100),
            ("DICT_6X6_250", 6, 250),
            ("DICT_APRILTAG_36h11", 6, 587),
        ] {
            let d = MarkerDictionary::named(name).unwrap();
            assert_eq!((d.side(), d.count()), (side, count), "{name}");
        }
        for name in ["DICT_4X4_1000", "DICT_4X4", "4X4_50", "DICT_APRILTAG_36h11_50", ""] {
            assert_eq!(MarkerDictionary::named(name), None, "{name}");
        }
    }

    #[test]
    fn a_marker_is_read_whichever_side_is_up_and_with_one_module_wrong() {
        for name in ["DICT_4X4_250", "DICT_5X5_250", "DICT_6X6_250", "DICT_APRILTAG_36h11"] {
            let d = MarkerDictionary::named(name).unwrap();
            for (marker, code) in d.codes.iter().enumerate() {
                let mut seen = *code;
                for quarters in [0, 3, 2, 1] {
                    assert_eq!(d.read(seen), Some((marker, quarters)), "{name}");
                    assert_eq!(d.read(seen ^ (1 << (marker % 16))), Some((marker, quarters)), "{name}");
                    seen = d.turned(seen);
                }
            }
            assert_eq!(d.read(0), None, "{name}");
        }
    }

    /// OpenCV's first marker of DICT_4X4_50.
    #[test]
    fn modules_are_in_the_order_of_the_rows() {
        let d = MarkerDictionary::named("DICT_4X4_50").unwrap();
        let rows = ["1011", "0101", "0011", "0010"];
        for (row, modules) in rows.iter().enumerate() {
            for (column, module) in modules.chars().enumerate() {
                assert_eq!(d.is_white(0, column, row), module == '1');
            }
        }
        assert!(!d.is_white(0, 4, 0) && !d.is_white(50, 0, 0));
    }
}
