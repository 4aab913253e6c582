//! Kernel command-line arguments, which each boot loader sets differently.

use super::tree::Tree;

/// Returns the command that adds arguments to the kernel's command line; `None` for an unknown boot loader, as in a
/// virtual machine whose kernel is started from outside.
pub(crate) fn add_arguments(tree: &dyn Tree, arguments: &str) -> Option<String> {
    /// File with the kernel arguments of a Raspberry Pi, in a single line.
    const FIRMWARE: &str = "boot/firmware/cmdline.txt";
    /// Reboot is left to the user: a pasted command must not reboot the machine.
    const REBOOT: &str = "# then reboot";
    if tree.has("usr/sbin/grubby") || tree.has("sbin/grubby") {
        return Some(format!(
            "sudo grubby --update-kernel=ALL --args='{arguments}' {REBOOT}"
        ));
    }
    if tree.has("etc/default/grub") {
        let update = if tree.has("usr/sbin/update-grub") {
            "sudo update-grub"
        } else {
            "sudo grub-mkconfig -o /boot/grub/grub.cfg"
        };
        return Some(format!(
            "sudo sed -i 's/^GRUB_CMDLINE_LINUX=\"/&{arguments} /' /etc/default/grub && {update} {REBOOT}"
        ));
    }
    tree.has(FIRMWARE)
        .then(|| format!("sudo sed -i '1s/$/ {arguments}/' /{FIRMWARE} {REBOOT}"))
}

/// Returns the value of the last `name=value` on the kernel's command line, which is the effective one.
pub(crate) fn argument<'a>(command_line: &'a str, name: &str) -> Option<&'a str> {
    let value = |word: &'a str| word.strip_prefix(name)?.strip_prefix('=');
    command_line.split_ascii_whitespace().rev().find_map(value)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::tree::Fake;

    #[test]
    fn each_boot_loader_has_its_own_command() {
        #[rustfmt::skip] // a table
        let cases: [(&[&str], Option<&str>); 5] = [
            (&["usr/sbin/grubby", "etc/default/grub"],
             Some("sudo grubby --update-kernel=ALL --args='a=1 b' # then reboot")),
            (&["etc/default/grub", "usr/sbin/update-grub"],
             Some("sudo sed -i 's/^GRUB_CMDLINE_LINUX=\"/&a=1 b /' /etc/default/grub && sudo update-grub # then reboot")),
            (&["etc/default/grub"],
             Some("sudo sed -i 's/^GRUB_CMDLINE_LINUX=\"/&a=1 b /' /etc/default/grub && sudo grub-mkconfig -o /boot/grub/grub.cfg # then reboot")),
            (&["boot/firmware/cmdline.txt"],
             Some("sudo sed -i '1s/$/ a=1 b/' /boot/firmware/cmdline.txt # then reboot")),
            (&[], None),
        ];
        for (files, expected) in cases {
            let files: Vec<_> = files.iter().map(|path| (*path, "")).collect();
            let command = add_arguments(&Fake::new(&files), "a=1 b");
            assert_eq!(command.as_deref(), expected, "{files:?}");
        }
    }

    #[test]
    fn the_last_argument_of_a_name_is_effective() {
        let line = "quiet preempt=none xpreempt=lazy preempt=full preempt";
        assert_eq!(argument(line, "preempt"), Some("full"));
        assert_eq!(argument(line, "idle"), None);
    }
}
