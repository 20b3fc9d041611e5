//! Who gives way when the CPU is short: the work that may be late to the work that must not.
//!
//! Only downwards, which needs no privilege. What must come before the rest of the machine: [`crate::realtime`].

/// Puts the calling thread, and the threads that it starts from now on, `niceness` places behind (0 to 19).
///
/// # Errors
/// What the system answers when it refuses.
pub fn lower_this_thread(niceness: u8) -> std::io::Result<()> {
    // Linux keeps the priority by thread, and 0 is the caller.
    if niceness > 0 {
        rustix::process::setpriority_process(None, i32::from(niceness))?;
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_the_thread_that_asks_and_its_children_give_way() {
        let mine = || rustix::process::getpriority_process(None).unwrap();
        let before = mine();
        let lowered = std::thread::spawn(move || {
            lower_this_thread(19).unwrap();
            (mine(), std::thread::spawn(mine).join().unwrap())
        });
        assert_eq!(lowered.join().unwrap(), (19, 19));
        assert_eq!(mine(), before);
    }
}
