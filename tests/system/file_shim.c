/* File calls below a directory, recorded and made to fail (LD_PRELOAD): what a disk, and a power cut, may do.
 *
 *   SHIM_ROOT     absolute path; calls elsewhere are left alone
 *   SHIM_RECORD   file to which each call is appended: a line "op inode offset length path\tpath2", then `length` bytes
 *   SHIM_FAULT    file that holds "op errno skip"; it is read before each call, the call number `skip` of that kind that
 *                 comes after the file was written fails (errno 0 of a write: half of it is written), and it is emptied
 */
#define _GNU_SOURCE
#include <dlfcn.h>
#include <errno.h>
#include <fcntl.h>
#include <limits.h>
#include <pthread.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

static pthread_mutex_t turn = PTHREAD_MUTEX_INITIALIZER;

#define REAL(name, type) ((type)dlsym(RTLD_NEXT, name))
typedef int (*open_t)(const char *, int, ...);
typedef ssize_t (*write_t)(int, const void *, size_t);
typedef int (*sync_t)(int);
typedef int (*rename_t)(const char *, const char *);
typedef int (*path_t)(const char *);
typedef int (*truncate_t)(int, off_t);
typedef int (*mkdir_t)(const char *, mode_t);

static int is_below(const char *path)
{
    const char *root = getenv("SHIM_ROOT");
    return root && path && strncmp(path, root, strlen(root)) == 0;
}

static const char *path_of(int fd, char *path)
{
    char link[64];
    snprintf(link, sizeof link, "/proc/self/fd/%d", fd);
    ssize_t length = readlink(link, path, PATH_MAX - 1);
    path[length > 0 ? length : 0] = 0;
    return path;
}

static unsigned long inode_of(int fd)
{
    struct stat found;
    return fstat(fd, &found) == 0 ? (unsigned long)found.st_ino : 0;
}

/* -1: go on; else the errno with which the call fails (0: a short write). */
static int fault_of(const char *op)
{
    const char *file = getenv("SHIM_FAULT");
    char kind[32] = "";
    int number = 0, skip = 0, found = -1;
    FILE *stream;
    if (!file)
        return -1;
    int fd = REAL("open", open_t)(file, O_RDONLY | O_CLOEXEC);
    if (fd < 0)
        return -1;
    char text[128];
    ssize_t length = read(fd, text, sizeof text - 1);
    close(fd);
    text[length > 0 ? length : 0] = 0;
    if (sscanf(text, "%31s %d %d", kind, &number, &skip) != 3 || strcmp(kind, op) != 0)
        return -1;
    fd = REAL("open", open_t)(file, O_WRONLY | O_TRUNC | O_CLOEXEC);
    if (fd < 0)
        return -1;
    stream = fdopen(fd, "w");
    if (skip > 0)
        fprintf(stream, "%s %d %d", kind, number, skip - 1);
    else
        found = number;
    fclose(stream);
    return found;
}

static void record(const char *op, unsigned long inode, off_t offset, const void *data, size_t length,
                   const char *path, const char *path2)
{
    const char *file = getenv("SHIM_RECORD");
    char head[2 * PATH_MAX + 128];
    if (!file)
        return;
    int fd = REAL("open", open_t)(file, O_WRONLY | O_CREAT | O_APPEND | O_CLOEXEC, 0600);
    if (fd < 0)
        return;
    int size = snprintf(head, sizeof head, "%s %lu %lld %zu %s\t%s\n", op, inode, (long long)offset, length, path,
                        path2 ? path2 : "");
    REAL("write", write_t)(fd, head, (size_t)size);
    if (length)
        REAL("write", write_t)(fd, data, length);
    close(fd);
}

static int opened(const char *path, int flags, mode_t mode)
{
    if (!is_below(path) || !(flags & (O_CREAT | O_TRUNC | O_WRONLY | O_RDWR)))
        return REAL("open", open_t)(path, flags, mode);
    pthread_mutex_lock(&turn);
    int error = fault_of("open"), fd = -1;
    if (error > 0) {
        errno = error;
    } else {
        struct stat before;
        int existed = stat(path, &before) == 0;
        fd = REAL("open", open_t)(path, flags, mode);
        int saved = errno;
        if (fd >= 0 && !existed)
            record("create", inode_of(fd), 0, NULL, 0, path, NULL);
        if (fd >= 0 && existed && (flags & O_TRUNC))
            record("truncate", inode_of(fd), 0, NULL, 0, path, NULL);
        errno = saved;
    }
    pthread_mutex_unlock(&turn);
    return fd;
}

#define MODE_OF(flags, last)                                                                                           \
    mode_t mode = 0;                                                                                                   \
    if ((flags) & (O_CREAT | O_TMPFILE)) {                                                                             \
        va_list list;                                                                                                  \
        va_start(list, last);                                                                                          \
        mode = va_arg(list, mode_t);                                                                                   \
        va_end(list);                                                                                                  \
    }

int open(const char *path, int flags, ...)
{
    MODE_OF(flags, flags)
    return opened(path, flags, mode);
}

int open64(const char *path, int flags, ...)
{
    MODE_OF(flags, flags)
    return opened(path, flags, mode);
}

ssize_t write(int fd, const void *data, size_t length)
{
    char path[PATH_MAX];
    if (!is_below(path_of(fd, path)))
        return REAL("write", write_t)(fd, data, length);
    pthread_mutex_lock(&turn);
    int error = fault_of("write");
    ssize_t done = -1;
    if (error > 0) {
        errno = error;
    } else {
        struct stat found;
        off_t offset = lseek(fd, 0, SEEK_CUR);
        if ((fcntl(fd, F_GETFL) & O_APPEND) && fstat(fd, &found) == 0)
            offset = found.st_size;
        done = REAL("write", write_t)(fd, data, error == 0 && length > 1 ? length / 2 : length);
        int saved = errno;
        if (done > 0)
            record("write", inode_of(fd), offset, data, (size_t)done, path, NULL);
        errno = saved;
    }
    pthread_mutex_unlock(&turn);
    return done;
}

static int synced(const char *name, int fd)
{
    char path[PATH_MAX];
    if (!is_below(path_of(fd, path)))
        return REAL(name, sync_t)(fd);
    pthread_mutex_lock(&turn);
    int error = fault_of(name), done = -1;
    if (error > 0) {
        errno = error;
    } else {
        done = REAL(name, sync_t)(fd);
        record("sync", inode_of(fd), 0, NULL, 0, path, NULL);
    }
    pthread_mutex_unlock(&turn);
    return done;
}

int fsync(int fd) { return synced("fsync", fd); }
int fdatasync(int fd) { return synced("fdatasync", fd); }

int rename(const char *from, const char *to)
{
    if (!is_below(from))
        return REAL("rename", rename_t)(from, to);
    pthread_mutex_lock(&turn);
    int error = fault_of("rename"), done = -1;
    if (error > 0) {
        errno = error;
    } else {
        done = REAL("rename", rename_t)(from, to);
        if (done == 0)
            record("rename", 0, 0, NULL, 0, from, to);
    }
    pthread_mutex_unlock(&turn);
    return done;
}

int unlink(const char *path)
{
    if (!is_below(path))
        return REAL("unlink", path_t)(path);
    pthread_mutex_lock(&turn);
    int error = fault_of("unlink"), done = -1;
    if (error > 0) {
        errno = error;
    } else {
        done = REAL("unlink", path_t)(path);
        int saved = errno;
        if (done == 0)
            record("unlink", 0, 0, NULL, 0, path, NULL);
        errno = saved;
    }
    pthread_mutex_unlock(&turn);
    return done;
}

static int truncated(const char *name, int fd, off_t length)
{
    char path[PATH_MAX];
    if (!is_below(path_of(fd, path)))
        return REAL(name, truncate_t)(fd, length);
    pthread_mutex_lock(&turn);
    int error = fault_of("ftruncate"), done = -1;
    if (error > 0) {
        errno = error;
    } else {
        done = REAL(name, truncate_t)(fd, length);
        if (done == 0)
            record("truncate", inode_of(fd), length, NULL, 0, path, NULL);
    }
    pthread_mutex_unlock(&turn);
    return done;
}

int ftruncate(int fd, off_t length) { return truncated("ftruncate", fd, length); }
int ftruncate64(int fd, off_t length) { return truncated("ftruncate64", fd, length); }

int mkdir(const char *path, mode_t mode)
{
    int done = REAL("mkdir", mkdir_t)(path, mode);
    if (done == 0 && is_below(path))
        record("mkdir", 0, 0, NULL, 0, path, NULL);
    return done;
}
