//! Square markers of black and white modules that carry a number.

/// Numbered square markers of so many modules a side, each within a black border of one module.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct MarkerDictionary {
    side: usize,
    codes: Vec<u64>,
    /// Modules that may be misread.
    misread: u32,
}

const DICTIONARIES: &str = include_str!("dictionaries.txt");
/// Markers of those dictionaries that come in several sizes, of which a smaller one is the beginning.
const SIZES: [(&str, usize); 4] = [("_50", 50), ("_100", 100), ("_250", 250), ("_1000", 1000)];

impl MarkerDictionary {
    /// What OpenCV calls so, in any case of letters: all of its predefined dictionaries, such as `DICT_4X4_50`,
    /// `DICT_7X7_1000`, `DICT_ARUCO_ORIGINAL`, `DICT_APRILTAG_36h11` and `DICT_ARUCO_MIP_36h12`; `None` for
    /// others.
    pub fn named(name: &str) -> Option<Self> {
        let lines = DICTIONARIES.lines().filter(|l| !l.starts_with('#'));
        lines.filter_map(|line| line.split_once(' ')).find_map(|(family, numbers)| {
            let of_size = |(ending, count): &(&str, usize)| {
                format!("{family}{ending}").eq_ignore_ascii_case(name).then_some(*count)
            };
            let count = match family.as_bytes().get(5).is_some_and(u8::is_ascii_digit) {
                true => SIZES.iter().find_map(of_size)?,
                false => family.eq_ignore_ascii_case(name).then_some(usize::MAX)?,
            };
            let (side, codes) = numbers.split_once(' ')?;
            let codes = codes.split(' ').take(count).map(|c| u64::from_str_radix(c, 16));
            Some(Self::of(side.parse().ok()?, codes.collect::<Result<_, _>>().ok()?))
        })
    }

    fn of(side: usize, codes: Vec<u64>) -> Self {
        let mut out = Self { side, codes, misread: 0 };
        // One module is made good where any two markers, turned as they like, differ in three or more.
        out.misread = u32::from(out.least_difference() >= 3);
        out
    }

    /// The first so many of its markers: those of a board. No other can then be taken for one of them.
    pub(super) fn first(&self, count: usize) -> Self {
        Self::of(self.side, self.codes.iter().copied().take(count).collect())
    }

    /// In how many modules two markers, or two turns of one, differ at least.
    fn least_difference(&self) -> u32 {
        let mut least = u32::MAX;
        for (k, code) in self.codes.iter().enumerate() {
            let mut turned = *code;
            for quarters in 0..4 {
                let others = &self.codes[k + usize::from(quarters == 0)..];
                least = others.iter().map(|c| (c ^ turned).count_ones()).fold(least, u32::min);
                turned = self.turned(turned);
            }
        }
        least
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
    /// near as one misread module, or none at all in dictionaries whose markers differ too little.
    pub(super) fn read(&self, mut modules: u64) -> Option<(usize, usize)> {
        for quarters in 0..4 {
            let same = |code: &u64| (code ^ modules).count_ones() <= self.misread;
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

    /// Names, modules a side and markers, from the list in OpenCV's documentation.
    const ALL: [(&str, usize, usize); 22] = [
        ("DICT_4X4_50", 4, 50),
        ("DICT_4X4_100", 4, 100),
        ("DICT_4X4_250", 4, 250),
        ("DICT_4X4_1000", 4, 1000),
        ("DICT_5X5_50", 5, 50),
        ("DICT_5X5_100", 5, 100),
        ("DICT_5X5_250", 5, 250),
        ("DICT_5X5_1000", 5, 1000),
        ("DICT_6X6_50", 6, 50),
        ("DICT_6X6_100", 6, 100),
        ("DICT_6X6_250", 6, 250),
        ("DICT_6X6_1000", 6, 1000),
        ("DICT_7X7_50", 7, 50),
        ("DICT_7X7_100", 7, 100),
        ("DICT_7X7_250", 7, 250),
        ("DICT_7X7_1000", 7, 1000),
        ("DICT_ARUCO_ORIGINAL", 5, 1024),
        ("DICT_APRILTAG_16h5", 4, 30),
        ("DICT_APRILTAG_25h9", 5, 35),
        ("DICT_APRILTAG_36h10", 6, 2320),
        ("DICT_APRILTAG_36H11", 6, 587),
        ("DICT_ARUCO_MIP_36h12", 6, 250),
    ];

    #[test]
    fn dictionaries_have_the_names_and_sizes_of_opencv() {
        for (name, side, count) in ALL {
            let d = MarkerDictionary::named(name).unwrap();
            assert_eq!((d.side(), d.count()), (side, count), "{name}");
        }
        for name in ["DICT_4X4_2000", "DICT_4X4", "4X4_50", "DICT_APRILTAG_36h11_50", ""] {
            assert_eq!(MarkerDictionary::named(name), None, "{name}");
        }
    }

    #[test]
    fn a_marker_is_read_whichever_side_is_up_and_with_one_module_wrong_where_markers_differ_enough() {
        for (name, ..) in ALL {
            let d = MarkerDictionary::named(name).unwrap();
            // Those of the original ArUco include some that look alike when they are turned; OpenCV corrects none of
            // 4X4_1000.
            let is_apart = !["DICT_4X4_1000", "DICT_ARUCO_ORIGINAL"].contains(&name);
            assert_eq!(d.misread, u32::from(is_apart), "{name}");
            if d.least_difference() == 0 {
                continue;
            }
            for (marker, code) in d.codes.iter().enumerate().step_by(7) {
                let mut seen = *code;
                for quarters in [0, 3, 2, 1] {
                    assert_eq!(d.read(seen), Some((marker, quarters)), "{name}");
                    let wrong = Some((marker, quarters)).filter(|_| d.misread == 1);
                    assert!(wrong.is_none() || d.read(seen ^ (1 << (marker % 16))) == wrong, "{name}");
                    seen = d.turned(seen);
                }
            }
        }
        let of_board = MarkerDictionary::named("DICT_4X4_1000").unwrap().first(24);
        assert_eq!((of_board.misread, of_board.count()), (1, 24));
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
