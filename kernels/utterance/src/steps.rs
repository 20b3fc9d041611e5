//! Counts what the parser does most, in tests only: the proof that its work is linear in the words.

#[cfg(test)]
thread_local! {
    static N_STEPS: std::cell::Cell<u64> = const { std::cell::Cell::new(0) };
}

/// One look-up, comparison or name.
pub fn step() {
    #[cfg(test)]
    N_STEPS.with(|n_steps| n_steps.set(n_steps.get() + 1));
}

#[cfg(test)]
mod tests {
    use super::N_STEPS;
    use geometry::Profile;

    /// Steps for a phrase repeated up to so many characters.
    fn steps_of(phrase: &str, n_chars: usize) -> u64 {
        let text = phrase.repeat(n_chars / phrase.len());
        N_STEPS.with(|n_steps| n_steps.set(0));
        let reply = crate::parse(&[], &Profile::sim(), &text);
        assert!(!reply.say.is_empty());
        N_STEPS.with(std::cell::Cell::get)
    }

    #[test]
    fn work_grows_no_faster_than_the_words() {
        for phrase in [
            "avoid the rug and ",
            "slow ",
            "the red sofa by the window ",
            "do not never ",
            "if you see a dog, stop. ",
            "stay 2 m and 3 feet from ",
            "not the zorb, not the quux, ",
            "between a and b ",
            "because it is so ",
            "aviod the kichen ",
            "ignore the ",
            "forget the rug, make it 2 m, ",
            "all but the ",
            ", . ; ",
            "x",
            "1.",
            "a-b-c-",
            "everything except the one in the ",
        ] {
            let (half, whole) = (steps_of(phrase, 900), steps_of(phrase, 1800));
            // Twice the words, twice the work, and a little for the ends.
            assert!(whole <= 2 * half + half / 4 + 200, "{phrase:?}: {half} steps, then {whole}");
        }
    }
}
