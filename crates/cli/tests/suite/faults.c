/* A disk that fails once, loaded before the C library (LD_PRELOAD): the call number FAIL_AT of those that
 * change a file fails, and the file FAILED says so. A write is done by half first, as on a full disk.
 * FAIL_CALL counts the calls of that name alone. */
#define _GNU_SOURCE
#include <errno.h>
#include <fcntl.h>
#include <stdarg.h>
#include <stdatomic.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <sys/syscall.h>
#include <unistd.h>

static atomic_int calls;
static atomic_int full;

static int fails(const char *call) {
    const char *at = getenv("FAIL_AT"), *mark = getenv("FAILED"), *only = getenv("FAIL_CALL");
    if (only && strcmp(only, call) != 0) return 0;
    if (!at || !mark || atomic_fetch_add(&calls, 1) + 1 != atoi(at)) return 0;
    syscall(SYS_close, syscall(SYS_openat, AT_FDCWD, mark, O_CREAT | O_WRONLY, 0600));
    return 1;
}

static int regular(int file) {
    struct stat data;
    return fstat(file, &data) == 0 && S_ISREG(data.st_mode);
}

static int refuse(int why) {
    errno = why;
    return -1;
}

ssize_t write(int file, const void *bytes, size_t count) {
    if (file > 2 && regular(file)) {
        if (atomic_exchange(&full, 0)) return refuse(ENOSPC);
        if (fails("write")) {
            if (count < 2) return refuse(ENOSPC);
            atomic_store(&full, 1);
            count /= 2;
        }
    }
    return syscall(SYS_write, file, bytes, count);
}

int fsync(int file) { return fails("fsync") ? refuse(EIO) : (int)syscall(SYS_fsync, file); }

int fdatasync(int file) { return fails("fdatasync") ? refuse(EIO) : (int)syscall(SYS_fdatasync, file); }

int ftruncate(int file, off_t size) {
    return fails("ftruncate") ? refuse(EIO) : (int)syscall(SYS_ftruncate, file, size);
}

int ftruncate64(int file, off64_t size) { return ftruncate(file, size); }

int rename(const char *from, const char *to) {
    return fails("rename") ? refuse(EIO) : (int)syscall(SYS_renameat2, AT_FDCWD, from, AT_FDCWD, to, 0);
}

int unlink(const char *path) {
    return fails("unlink") ? refuse(EIO) : (int)syscall(SYS_unlinkat, AT_FDCWD, path, 0);
}

static int open_file(const char *path, int flags, int mode) {
    if ((flags & O_CREAT) && fails("open")) return refuse(ENOSPC);
    return (int)syscall(SYS_openat, AT_FDCWD, path, flags, mode);
}

#define MODE(flags, mode) \
    int mode = 0; \
    if ((flags) & O_CREAT) { \
        va_list rest; \
        va_start(rest, flags); \
        mode = va_arg(rest, int); \
        va_end(rest); \
    }

int open(const char *path, int flags, ...) {
    MODE(flags, mode)
    return open_file(path, flags, mode);
}

int open64(const char *path, int flags, ...) {
    MODE(flags, mode)
    return open_file(path, flags, mode);
}
