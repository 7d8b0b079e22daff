//! What the standard library does not offer of Linux.

use std::ffi::{c_int, c_void};
use std::io::{Error, Result};

const AF_UNIX: c_int = 1;
const SOCK_SEQPACKET: c_int = 5;
const SOCK_CLOEXEC: c_int = 0o2_000_000;
const SOL_SOCKET: c_int = 1;
const SO_SNDBUF: c_int = 7;
const SO_PEERCRED: c_int = 17;
const SCHED_FIFO: c_int = 1;
static PRIORITY: c_int = 50;
static SEND_BUFFER: c_int = 4 << 20;

unsafe extern "C" {
    fn socket(domain: c_int, kind: c_int, protocol: c_int) -> c_int;
    fn getsockopt(
        fd: c_int,
        level: c_int,
        name: c_int,
        value: *mut c_void,
        size: *mut u32,
    ) -> c_int;
    fn setsockopt(fd: c_int, level: c_int, name: c_int, value: *const c_void, size: u32) -> c_int;
    fn sched_setscheduler(process: c_int, policy: c_int, parameters: *const c_int) -> c_int;
    safe fn geteuid() -> u32;
}

/// Linux's `struct ucred`.
#[repr(C)]
#[derive(Default)]
struct Credentials {
    process: i32,
    user: u32,
    group: u32,
}

pub fn seqpacket_socket() -> Result<c_int> {
    // SAFETY: takes and returns numbers only.
    match unsafe { socket(AF_UNIX, SOCK_SEQPACKET | SOCK_CLOEXEC, 0) } {
        -1 => Err(Error::last_os_error()),
        fd => Ok(fd),
    }
}

/// Whether the process at the other end is of this user, or root's.
pub fn is_host_trusted(fd: c_int) -> bool {
    let mut found = Credentials::default();
    let mut size = size_of::<Credentials>() as u32;
    // SAFETY: the kernel writes at most `size` bytes, which `found` has.
    let done =
        unsafe { getsockopt(fd, SOL_SOCKET, SO_PEERCRED, (&raw mut found).cast(), &raw mut size) };
    done == 0 && (found.user == 0 || found.user == geteuid())
}

/// Ask for room for many frames; what is refused is gone without.
pub fn enlarge_send_buffer(fd: c_int) {
    let size = size_of::<c_int>() as u32;
    // SAFETY: the kernel reads `size` bytes of a static.
    unsafe { setsockopt(fd, SOL_SOCKET, SO_SNDBUF, (&raw const SEND_BUFFER).cast(), size) };
}

/// Ask for the scheduler of real time; what is refused is gone without.
pub fn enter_realtime() {
    // SAFETY: `struct sched_param` is one int, read only.
    unsafe { sched_setscheduler(0, SCHED_FIFO, &raw const PRIORITY) };
}
