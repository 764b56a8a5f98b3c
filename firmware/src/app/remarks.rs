//! Remarks for people, which the board writes without a request: the result of saving
//! settings, the sentence of a fault, the help, and the self-test.

use ufmt::uWrite;
use wire::{line::Sealed, reply::REMARK};

use super::{App, saving::Saving, take_model, texts::Texts};
use wire::stretch::Probe;

impl App {
    /// Writes at most one line that has been waiting: `#: saved` or `#: not saved`,
    /// the sentence of a fault, help, the self-test. Long lines come every fourth
    /// period, so that the cable keeps up.
    ///
    /// # Errors
    ///
    /// Errors of the output.
    #[inline(never)]
    pub fn report<W: uWrite + ?Sized>(
        &mut self,
        texts: &impl Texts,
        out: &mut W,
        probe: &mut impl Probe,
    ) -> Result<(), W::Error> {
        if let Saving::Over { kept } = self.saving {
            self.saving = Saving::No;
            let mut line = Sealed::new(out);
            line.write_str(REMARK)?;
            if !kept {
                line.write_str("not ")?;
            }
            line.write_str("saved")?;
            return line.finish();
        }
        // A sentence and the telemetry do not fit into one period on the cable.
        if !self.sequence.is_multiple_of(4) {
            return Ok(());
        }
        if let Some(fault) = self.sentence.take() {
            let mut line = Sealed::new(out);
            line.write_str(REMARK)?;
            texts.fault(fault, &mut line)?;
            return line.finish();
        }
        if let Some(test) = &mut self.self_test {
            if !test.advance(&mut self.predictor, out, probe)? {
                self.self_test = None;
                if !take_model(&mut self.predictor, &self.settings) {
                    self.predictor.clear();
                }
            }
            return Ok(());
        }
        let Some(index) = self.help else {
            return Ok(());
        };
        let mut line = Sealed::new(out);
        line.write_str(REMARK)?;
        let more = texts.help(index, &mut line)?;
        line.finish()?;
        self.help = more.then_some(index.saturating_add(1));
        Ok(())
    }
}
