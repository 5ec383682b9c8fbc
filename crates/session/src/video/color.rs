//! How an H.264 stream codes colour: the video usability information of its sequence parameter set.

use h264_reader::nal::sps::SeqParameterSet;
use h264_reader::nal::{Nal, RefNal};
use mavsight_vision::YuvMatrix;
use smart_default::SmartDefault;

/// Range and matrix of a YUV video; where the stream does not say, those that ffmpeg's scaler assumes.
#[derive(Debug, Clone, Copy, PartialEq, Eq, SmartDefault)]
pub(crate) struct YuvCoding {
    pub(crate) full_range: bool,
    #[default(YuvMatrix::Bt601)]
    pub(crate) matrix: YuvMatrix,
}

impl YuvCoding {
    /// From a sequence parameter set (ITU-T H.264, 7.3.2.1.1 and E.1.1), its NAL header byte included; the
    /// default where it does not say or cannot be read.
    pub(crate) fn from_sps(nal: &[u8]) -> Self {
        // The library asserts that there is a header.
        if nal.is_empty() {
            return Self::default();
        }
        let parameters = SeqParameterSet::from_bits(RefNal::new(nal, &[], true).rbsp_bits()).ok();
        let signal = parameters.and_then(|p| p.vui_parameters?.video_signal_type);
        signal.map_or_else(Self::default, |signal| {
            // Code points of ITU-T H.273: 1 is BT.709 and so, closely enough to find colours, is BT.2020.
            let is_bt709 =
                signal.colour_description.is_some_and(|c| matches!(c.matrix_coefficients, 1 | 9 | 10));
            let matrix = if is_bt709 { YuvMatrix::Bt709 } else { YuvMatrix::Bt601 };
            Self { full_range: signal.video_full_range_flag, matrix }
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_empty_parameter_set_says_nothing() {
        assert_eq!(YuvCoding::from_sps(&[]), YuvCoding::default());
    }
}
