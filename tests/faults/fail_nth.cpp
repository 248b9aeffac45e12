// SPDX-License-Identifier: Apache-2.0
// A library for LD_PRELOAD that makes one call of a program fail, to see that the program ends with
// one plain error and loses nothing. It counts calls of each kind from main() on, until main()
// returns, in all threads.
//
//   GS_FAULT=KIND:N:HOW    the N-th call of a kind, from 1 on; "N+" is that call and all after it.
//                          HOW is the name of an error (ENOSPC) or KILL, which ends the process by
//                          SIGKILL in place of the call. `memory` throws std::bad_alloc and needs
//                          no HOW. Without GS_FAULT calls are only counted.
//   GS_FAULT_ROOT=DIR      of the kinds with files, only calls on files below DIR count
//   GS_FAULT_LOG=FILE      gets a line "fired ..." with the call and its stack when a fault is
//                          injected, and a line "counts ..." when main() returns
//   GS_FAULT_DEPTH=1       not this program, but the programs of our own that it starts (each
//                          counts for itself); 0, the default, leaves all children alone
//
// Threads and memory fail where our own code asks for them. What another library, such as OpenCV,
// asks for is passed over, since its own mistakes cannot be mended here; the next call that is ours
// fails. Once the N-th thread was refused, "N+" refuses those of libraries, too.
// A call to the C library from within that library cannot be replaced. So stdio counts at its own
// functions: fwrite and fflush fail where their write would.
#include <dirent.h>
#include <dlfcn.h>
#include <errno.h>
#include <execinfo.h>
#include <fcntl.h>
#include <pthread.h>
#include <signal.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/sendfile.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <sys/uio.h>
#include <unistd.h>

#include <atomic>
#include <initializer_list>
#include <new>

extern char** environ;

namespace {

enum Kind { kOpen, kRead, kWrite, kRename, kFolder, kSync, kSpawn, kThread, kMemory, kKinds };
constexpr const char* kNames[kKinds] = {"open", "read",  "write",  "rename", "folder",
                                        "sync", "spawn", "thread", "memory"};
constexpr int kKill = -1;  // in place of an error

struct NamedError {
  const char* name;
  int number;
};
constexpr NamedError kErrors[] = {{"EACCES", EACCES}, {"EAGAIN", EAGAIN}, {"EDQUOT", EDQUOT},
                                  {"EINTR", EINTR},   {"EIO", EIO},       {"EMFILE", EMFILE},
                                  {"ENFILE", ENFILE}, {"ENOENT", ENOENT}, {"ENOMEM", ENOMEM},
                                  {"ENOSPC", ENOSPC}, {"EROFS", EROFS},   {"KILL", kKill}};

// What fails, from the environment.
struct Fault {
  int kind = -1;
  long first = 0;
  bool and_all_after = false;
  int error = 0;
};

Fault fault;
char root[4096] = "";
int log_file = -1;
std::atomic<bool> is_counting{false};
std::atomic<long> counts[kKinds];
std::atomic<bool> has_fired{false};
thread_local int libraries_loading = 0;  // their many allocations do not count

// ---- the log, without allocations ----------------------------------------------------------------

void log_line(const char* format, ...) __attribute__((format(printf, 1, 2)));
void log_line(const char* format, ...) {
  if (log_file < 0) return;
  char line[4600];
  va_list values;
  va_start(values, format);
  const int bytes = vsnprintf(line, sizeof line, format, values);
  va_end(values);
  static const auto write_it = reinterpret_cast<decltype(&write)>(dlsym(RTLD_NEXT, "write"));
  if (write_it(log_file, line, size_t(bytes) < sizeof line ? size_t(bytes) : sizeof line - 1) < 0)
    return;
}

void log_stack() {
  void* frames[64];
  if (log_file >= 0) backtrace_symbols_fd(frames, backtrace(frames, 64), log_file);
}

void log_counts() {
  char line[512] = "";
  for (int kind = 0; kind < kKinds; ++kind)
    snprintf(line + strlen(line), sizeof line - strlen(line), " %s=%ld", kNames[kind],
             counts[kind].load());
  log_line("counts%s\n", line);
}

// ---- which call fails ----------------------------------------------------------------------------

// Parts of the names of files whose code counts as ours.
constexpr const char* kOurs[] = {"gemsplat", "fail_nth", "libstdc++", "libc.so",  "libm.so",
                                 "libgcc",   "libfmt",   "libspdlog", "ld-linux", "san.so"};

bool another_library_calls() {
  void* frames[256];
  const int count = backtrace(frames, 256);
  for (int i = 0; i < count; ++i) {
    Dl_info info{};
    if (dladdr(frames[i], &info) == 0 || !info.dli_fname) continue;
    const char* const slash = strrchr(info.dli_fname, '/');
    bool is_ours = false;
    for (const char* name : kOurs)
      is_ours |= strstr(slash ? slash : info.dli_fname, name) != nullptr;
    if (!is_ours) return true;
  }
  return false;
}

// Counts a call. Returns whether it fails; errno then says why.
bool fails(Kind kind, const char* call, const char* file = "") {
  if (!is_counting.load(std::memory_order_relaxed)) return false;
  const long n = ++counts[kind];
  if (kind != fault.kind || n < fault.first) return false;
  const bool is_first = !has_fired;
  if (!is_first && !fault.and_all_after) return false;
  const bool may_be_of_a_library = kind == kMemory || (kind == kThread && is_first);
  if (may_be_of_a_library && another_library_calls()) return false;
  if (is_first && !has_fired.exchange(true)) {
    is_counting = false;  // what the log needs does not count
    log_line("fired %s:%ld %s %s\n", kNames[kind], n, call, file);
    log_stack();
    is_counting = true;
  }
  if (fault.error == kKill) ::kill(::getpid(), SIGKILL);
  errno = fault.error;
  return true;
}

// What ferror() looks at, in the C library of GNU.
void set_error_of(FILE* file) {
  constexpr int kErrorSeen = 0x20;
  file->_flags |= kErrorSeen;
}

bool is_below_root(const char* path) {
  const size_t length = strlen(root);
  return strncmp(path, root, length) == 0 && (length == 0 || path[length] == '/');
}

bool fails_at(Kind kind, const char* call, const char* path, int folder = AT_FDCWD) {
  if (!is_counting.load(std::memory_order_relaxed)) return false;
  char whole[8192] = "";
  if (path[0] != '/') {
    char place[64] = "/proc/self/cwd";
    if (folder != AT_FDCWD) snprintf(place, sizeof place, "/proc/self/fd/%d", folder);
    const ssize_t length = readlink(place, whole, 4096);
    if (length < 0) return false;
    whole[length] = '/';
    whole[length + 1] = '\0';
  }
  strncat(whole, path, sizeof whole - strlen(whole) - 1);
  return is_below_root(whole) && fails(kind, call, whole);
}

bool fails_of(Kind kind, const char* call, int descriptor) {
  if (!is_counting.load(std::memory_order_relaxed)) return false;
  char place[64], path[4097] = "";
  snprintf(place, sizeof place, "/proc/self/fd/%d", descriptor);
  const int before = errno;
  const ssize_t length = readlink(place, path, sizeof path - 1);
  errno = before;
  if (length > 0) path[length] = '\0';
  return is_below_root(path) && fails(kind, call, path);
}

// ---- from main() on ------------------------------------------------------------------------------

void read_fault(const char* text) {
  for (int kind = 0; kind < kKinds; ++kind) {
    const size_t length = strlen(kNames[kind]);
    if (strncmp(text, kNames[kind], length) != 0 || text[length] != ':') continue;
    char* rest = nullptr;
    fault.first = strtol(text + length + 1, &rest, 10);
    fault.and_all_after = *rest == '+';
    fault.error = ENOMEM;
    for (const NamedError& error : kErrors)
      if (*rest && strcmp(strchr(rest, ':') ? strchr(rest, ':') + 1 : "", error.name) == 0)
        fault.error = error.number;
    fault.kind = kind;
  }
}

void prepare() {
  const char* const depth = getenv("GS_FAULT_DEPTH");
  if (depth && strcmp(depth, "0") != 0) {
    setenv("GS_FAULT_DEPTH", "0", 1);
    return;
  }
  if (const char* const text = getenv("GS_FAULT")) read_fault(text);
  if (const char* const folder = getenv("GS_FAULT_ROOT")) snprintf(root, sizeof root, "%s", folder);
  if (const char* const file = getenv("GS_FAULT_LOG"))
    log_file = open(file, O_WRONLY | O_CREAT | O_APPEND | O_CLOEXEC, 0666);
  for (const char* name : {"GS_FAULT", "GS_FAULT_ROOT", "GS_FAULT_LOG", "LD_PRELOAD"})
    unsetenv(name);
  void* frame[1];
  backtrace(frame, 1);  // loads what it needs
  // Finds now what a child calls between fork and exec: there dlsym() may wait for a thread of the
  // parent, for ever.
  if (open("", O_RDONLY) < 0 && write(-1, "", 0) < 0 && read(-1, frame, 0) < 0)
    execve("", environ, environ);
  is_counting = true;
}

using Main = int(int, char**, char**);
Main* real_main = nullptr;

void stop() {
  if (!is_counting.exchange(false)) return;
  log_counts();
}

int counted_main(int argc, char** argv, char** environment) {
  prepare();
  atexit(stop);
  const int code = real_main(argc, argv, environment);
  stop();
  return code;
}

}  // namespace

// The next function of that name, of the same type as the one that is being defined.
#define REAL(name) \
  static const auto real = reinterpret_cast<decltype(&::name)>(dlsym(RTLD_NEXT, #name))

extern "C" {

int __libc_start_main(Main* main, int argc, char** argv, void (*init)(), void (*fini)(),
                      void (*rtld_fini)(), void* stack_end) {
  using Start = int(Main*, int, char**, void (*)(), void (*)(), void (*)(), void*);
  const auto real = reinterpret_cast<Start*>(dlsym(RTLD_NEXT, "__libc_start_main"));
  // A program that is not ours, such as the shell in COLMAP's place, runs undisturbed.
  char file[4097] = "";
  if (readlink("/proc/self/exe", file, sizeof file - 1) < 0 || !strstr(file, "/gemsplat") ||
      strcmp(strrchr(file, '/'), "/gemsplat") != 0)
    return real(main, argc, argv, init, fini, rtld_fini, stack_end);
  real_main = main;
  return real(counted_main, argc, argv, init, fini, rtld_fini, stack_end);
}

// ---- files ---------------------------------------------------------------------------------------

// O_CREAT and O_TMPFILE come with a mode.
#define MODE_FROM(last)                                 \
  mode_t mode = 0;                                      \
  if (flags & (O_CREAT | (O_TMPFILE & ~O_DIRECTORY))) { \
    va_list values;                                     \
    va_start(values, last);                             \
    mode = va_arg(values, mode_t);                      \
    va_end(values);                                     \
  }

int open(const char* path, int flags, ...) {
  REAL(open);
  MODE_FROM(flags)
  return fails_at(kOpen, "open", path) ? -1 : real(path, flags, mode);
}
int open64(const char* path, int flags, ...) {
  REAL(open64);
  MODE_FROM(flags)
  return fails_at(kOpen, "open64", path) ? -1 : real(path, flags, mode);
}
int openat(int folder, const char* path, int flags, ...) {
  REAL(openat);
  MODE_FROM(flags)
  return fails_at(kOpen, "openat", path, folder) ? -1 : real(folder, path, flags, mode);
}
int openat64(int folder, const char* path, int flags, ...) {
  REAL(openat64);
  MODE_FROM(flags)
  return fails_at(kOpen, "openat64", path, folder) ? -1 : real(folder, path, flags, mode);
}
int creat(const char* path, mode_t mode) {
  REAL(creat);
  return fails_at(kOpen, "creat", path) ? -1 : real(path, mode);
}
FILE* fopen(const char* path, const char* mode) {
  REAL(fopen);
  return fails_at(kOpen, "fopen", path) ? nullptr : real(path, mode);
}
FILE* fopen64(const char* path, const char* mode) {
  REAL(fopen64);
  return fails_at(kOpen, "fopen64", path) ? nullptr : real(path, mode);
}

ssize_t read(int descriptor, void* to, size_t bytes) {
  REAL(read);
  return fails_of(kRead, "read", descriptor) ? -1 : real(descriptor, to, bytes);
}
ssize_t pread(int descriptor, void* to, size_t bytes, off_t at) {
  REAL(pread);
  return fails_of(kRead, "pread", descriptor) ? -1 : real(descriptor, to, bytes, at);
}
size_t fread(void* to, size_t size, size_t count, FILE* file) {
  REAL(fread);
  if (!fails_of(kRead, "fread", fileno(file))) return real(to, size, count, file);
  set_error_of(file);
  return 0;
}

ssize_t write(int descriptor, const void* data, size_t bytes) {
  REAL(write);
  return fails_of(kWrite, "write", descriptor) ? -1 : real(descriptor, data, bytes);
}
ssize_t pwrite(int descriptor, const void* data, size_t bytes, off_t at) {
  REAL(pwrite);
  return fails_of(kWrite, "pwrite", descriptor) ? -1 : real(descriptor, data, bytes, at);
}
ssize_t writev(int descriptor, const iovec* parts, int count) {
  REAL(writev);
  return fails_of(kWrite, "writev", descriptor) ? -1 : real(descriptor, parts, count);
}
ssize_t sendfile(int to, int from, off_t* at, size_t bytes) {
  REAL(sendfile);
  return fails_of(kWrite, "sendfile", to) ? -1 : real(to, from, at, bytes);
}
int ftruncate(int descriptor, off_t bytes) {
  REAL(ftruncate);
  return fails_of(kWrite, "ftruncate", descriptor) ? -1 : real(descriptor, bytes);
}
size_t fwrite(const void* data, size_t size, size_t count, FILE* file) {
  REAL(fwrite);
  if (!fails_of(kWrite, "fwrite", fileno(file))) return real(data, size, count, file);
  set_error_of(file);
  return 0;
}
int fflush(FILE* file) {
  REAL(fflush);
  return file && fails_of(kWrite, "fflush", fileno(file)) ? EOF : real(file);
}

int rename(const char* from, const char* to) {
  REAL(rename);
  return fails_at(kRename, "rename", to) ? -1 : real(from, to);
}
int renameat2(int from_folder, const char* from, int to_folder, const char* to, unsigned flags) {
  REAL(renameat2);
  return fails_at(kRename, "renameat2", to, to_folder)
             ? -1
             : real(from_folder, from, to_folder, to, flags);
}
int link(const char* from, const char* to) {
  REAL(link);
  return fails_at(kRename, "link", to) ? -1 : real(from, to);
}
int linkat(int from_folder, const char* from, int to_folder, const char* to, int flags) {
  REAL(linkat);
  return fails_at(kRename, "linkat", to, to_folder) ? -1
                                                    : real(from_folder, from, to_folder, to, flags);
}

int mkdir(const char* path, mode_t mode) {
  REAL(mkdir);
  return fails_at(kFolder, "mkdir", path) ? -1 : real(path, mode);
}
char* mkdtemp(char* name) {
  REAL(mkdtemp);
  return fails_at(kFolder, "mkdtemp", name) ? nullptr : real(name);
}
DIR* opendir(const char* path) {
  REAL(opendir);
  return fails_at(kFolder, "opendir", path) ? nullptr : real(path);
}
DIR* fdopendir(int descriptor) {
  REAL(fdopendir);
  return fails_of(kFolder, "fdopendir", descriptor) ? nullptr : real(descriptor);
}

int fsync(int descriptor) {
  REAL(fsync);
  return fails_of(kSync, "fsync", descriptor) ? -1 : real(descriptor);
}
int fdatasync(int descriptor) {
  REAL(fdatasync);
  return fails_of(kSync, "fdatasync", descriptor) ? -1 : real(descriptor);
}
int syncfs(int descriptor) noexcept {
  REAL(syncfs);
  return fails_of(kSync, "syncfs", descriptor) ? -1 : real(descriptor);
}

// ---- processes and threads -----------------------------------------------------------------------

pid_t fork() {
  REAL(fork);
  return fails(kSpawn, "fork") ? -1 : real();
}
int pipe2(int* ends, int flags) noexcept {
  REAL(pipe2);
  return fails(kSpawn, "pipe2") ? -1 : real(ends, flags);
}
int socketpair(int domain, int type, int protocol, int* ends) noexcept {
  REAL(socketpair);
  return fails(kSpawn, "socketpair") ? -1 : real(domain, type, protocol, ends);
}
int execve(const char* program, char* const* arguments, char* const* environment) noexcept {
  REAL(execve);
  return fails(kSpawn, "execve", program) ? -1 : real(program, arguments, environment);
}
int pthread_create(pthread_t* thread, const pthread_attr_t* attributes, void* (*body)(void*),
                   void* argument) {
  REAL(pthread_create);
  return fails(kThread, "pthread_create") ? errno : real(thread, attributes, body, argument);
}

}  // extern "C"

// ---- memory --------------------------------------------------------------------------------------

extern "C" void* dlopen(const char* file, int flags) noexcept {
  REAL(dlopen);
  ++libraries_loading;
  void* const library = real(file, flags);
  --libraries_loading;
  return library;
}

namespace {

void* allocate(size_t bytes, size_t alignment = 0) noexcept {
  if (libraries_loading == 0 && fails(kMemory, "operator new")) return nullptr;
  if (bytes == 0) bytes = 1;
  if (alignment == 0) return malloc(bytes);
  return aligned_alloc(alignment, (bytes + alignment - 1) / alignment * alignment);
}

void* allocate_or_throw(size_t bytes, size_t alignment = 0) {
  if (void* const memory = allocate(bytes, alignment)) return memory;
  if (const std::new_handler handler = std::get_new_handler()) handler();  // which throws
  throw std::bad_alloc();
}

}  // namespace

// All forms, since a `delete` must know the memory of each `new`.
void* operator new(size_t n) { return allocate_or_throw(n); }
void* operator new[](size_t n) { return allocate_or_throw(n); }
void* operator new(size_t n, const std::nothrow_t&) noexcept { return allocate(n); }
void* operator new[](size_t n, const std::nothrow_t&) noexcept { return allocate(n); }
void* operator new(size_t n, std::align_val_t a) { return allocate_or_throw(n, size_t(a)); }
void* operator new[](size_t n, std::align_val_t a) { return allocate_or_throw(n, size_t(a)); }
void* operator new(size_t n, std::align_val_t a, const std::nothrow_t&) noexcept {
  return allocate(n, size_t(a));
}
void* operator new[](size_t n, std::align_val_t a, const std::nothrow_t&) noexcept {
  return allocate(n, size_t(a));
}
void operator delete(void* p) noexcept { free(p); }
void operator delete[](void* p) noexcept { free(p); }
void operator delete(void* p, size_t) noexcept { free(p); }
void operator delete[](void* p, size_t) noexcept { free(p); }
void operator delete(void* p, const std::nothrow_t&) noexcept { free(p); }
void operator delete[](void* p, const std::nothrow_t&) noexcept { free(p); }
void operator delete(void* p, std::align_val_t) noexcept { free(p); }
void operator delete[](void* p, std::align_val_t) noexcept { free(p); }
void operator delete(void* p, size_t, std::align_val_t) noexcept { free(p); }
void operator delete[](void* p, size_t, std::align_val_t) noexcept { free(p); }
