#define AMPS_OWN_SOURCE
#include "amps/file_io.h"

#include <algorithm>
#include <cerrno>
#include <chrono>
#include <cstdio>
#include <system_error>

#ifndef _WIN32
#include <fcntl.h>
#include <sys/file.h>
#include <sys/stat.h>
#include <unistd.h>
#endif

namespace amps {
namespace detail {
namespace {

constexpr const char* kNoRoom = "; free some space or choose another place";
constexpr const char* kNoPermission = "; check its permissions";

// An open output file, closed and, if it is a temporary that was not completed, removed at the end of its scope.
struct OutputFile {
  std::filesystem::path temporary;  // empty: none
  std::FILE* file = nullptr;
  int lock = -1;  // a second descriptor of a temporary, which keeps it locked when the first is closed

  OutputFile() = default;
  OutputFile(const OutputFile&) = delete;
  OutputFile& operator=(const OutputFile&) = delete;
  ~OutputFile() {
    if (file != nullptr) std::fclose(file);
    std::error_code ignored;
    if (!temporary.empty()) std::filesystem::remove(temporary, ignored);
#ifndef _WIN32
    if (lock >= 0) ::close(lock);
#endif
  }

  // False (and errno) on failure.
  bool write(std::string_view content, const Execution& run) {
    errno = 0;
    bool written = true;
    for (std::size_t at = 0; written && at < content.size();) {
      const std::size_t piece = std::min(content.size() - at, kBytesPerPiece);
      written = std::fwrite(content.data() + at, 1, piece, file) == piece;
      at += piece;
      run.report(static_cast<double>(at) / static_cast<double>(content.size()));
    }
    return written && std::fflush(file) == 0;
  }
  // Tells what a full disk or a network drive kept back.
  bool close() {
    errno = 0;
    const bool closed = std::fclose(file) == 0;
    file = nullptr;
    return closed;
  }
};

#ifdef _WIN32

std::FILE* open_output(const std::filesystem::path& path, bool existing) {
  return _wfopen(path.c_str(), existing ? L"r+b" : L"wb");
}

bool may_write(const std::filesystem::path&) { return true; }  // the read-only attribute is all that is looked at

bool create_temporary(OutputFile& output, const std::filesystem::path& name, bool) {
  output.file = _wfopen(name.c_str(), L"wbx");  // x: fails if it exists, so two writers never share one
  if (output.file != nullptr) output.temporary = name;
  return output.file != nullptr;
}

// Open files cannot be removed, but those about to be renamed are closed: they are young.
bool remove_left_over(const std::filesystem::path& name) {
  std::error_code error;
  const auto written = std::filesystem::last_write_time(name, error);
  if (error || std::filesystem::file_time_type::clock::now() - written < std::chrono::hours(1)) return false;
  return std::filesystem::remove(name, error);
}

bool give_owner_and_mode(const OutputFile&, const std::filesystem::path&) { return true; }

#else

std::FILE* open_output(const std::filesystem::path& path, bool existing) {
  return std::fopen(path.c_str(), existing ? "r+b" : "wb");
}

bool may_write(const std::filesystem::path& path) { return ::faccessat(AT_FDCWD, path.c_str(), W_OK, AT_EACCESS) == 0; }

// Creates a file that did not exist and locks it; false, and errno, if that cannot be. `secret`: nobody else may read it yet.
bool create_temporary(OutputFile& output, const std::filesystem::path& name, bool secret) {
  const int descriptor = ::open(name.c_str(), O_WRONLY | O_CREAT | O_EXCL | O_CLOEXEC, secret ? 0600 : 0666);
  if (descriptor < 0) return false;
  // Until it is locked, another writer may take it for a left-over. Where files cannot be locked, no left-over is known.
  struct stat status = {};
  const bool taken = ::flock(descriptor, LOCK_EX | LOCK_NB) != 0 && errno == EWOULDBLOCK;
  if (taken || (::fstat(descriptor, &status) == 0 && status.st_nlink == 0)) {
    ::close(descriptor);
    errno = EEXIST;
    return false;
  }
  output.temporary = name;
  output.lock = descriptor;
  const int second = ::fcntl(descriptor, F_DUPFD_CLOEXEC, 0);
  if (second >= 0 && (output.file = ::fdopen(second, "wb")) == nullptr) ::close(second);
  return output.file != nullptr;
}

bool remove_left_over(const std::filesystem::path& name) {
  struct stat status = {};
  if (::lstat(name.c_str(), &status) != 0 || !S_ISREG(status.st_mode) || status.st_uid != ::geteuid()) return false;
  const int descriptor = ::open(name.c_str(), O_WRONLY | O_NOFOLLOW | O_NONBLOCK | O_CLOEXEC);
  if (descriptor < 0) return false;
  // Its writer may have renamed it before it was locked here: then the name is none of this file any more.
  struct stat opened = {};
  const bool left_over = ::flock(descriptor, LOCK_EX | LOCK_NB) == 0 && ::fstat(descriptor, &opened) == 0 &&
                         ::lstat(name.c_str(), &status) == 0 && status.st_dev == opened.st_dev &&
                         status.st_ino == opened.st_ino;
  const bool removed = left_over && ::unlink(name.c_str()) == 0;
  ::close(descriptor);
  return removed;
}

// False if the temporary cannot get owner and group of the file it is to replace.
bool give_owner_and_mode(const OutputFile& output, const std::filesystem::path& target) {
  struct stat old = {}, fresh = {};
  if (::stat(target.c_str(), &old) != 0 || ::fstat(output.lock, &fresh) != 0) return false;
  const bool same = old.st_uid == fresh.st_uid && old.st_gid == fresh.st_gid;
  if (!same && ::fchown(output.lock, old.st_uid, old.st_gid) != 0) return false;
  constexpr mode_t all_modes = 07777;
  return ::fchmod(output.lock, old.st_mode & all_modes) == 0;
}

#endif

// Creates a temporary in the directory of `target`, and takes left-overs away.
void open_temporary(OutputFile& output, const std::filesystem::path& target, bool secret) {
  constexpr int most_tries = 10000;  // names taken by other writers
  constexpr int names_looked_at = 16;
  int i = 0;
  const auto name = [&] { return target.parent_path() / (".amps-" + std::to_string(i) + ".tmp"); };
  bool created = false;
  for (; i < most_tries && !created; ++i) {
    errno = 0;
    created = create_temporary(output, name(), secret);
    if (created) continue;
    if (errno != EEXIST) break;
    created = remove_left_over(name()) && create_temporary(output, name(), secret);
    errno = EEXIST;
  }
  if (!created) {
    fail_file(target, "cannot be created: " + system_message() + "; check that its directory exists and can be written");
  }
  std::error_code ignored;
  for (; i < names_looked_at || std::filesystem::exists(name(), ignored); ++i) {
    if (i >= most_tries || (!remove_left_over(name()) && i >= names_looked_at)) break;
  }
}

// A file to be written, as it is found.
struct OutputTarget {
  std::filesystem::path place;  // links followed
  bool exists = false;
  bool regular = true;       // else a device or pipe: renaming would replace it by a file
  bool other_names = false;  // hard links
};

OutputTarget look_at_target(const std::filesystem::path& path) {
  namespace fs = std::filesystem;
  std::error_code error;
  OutputTarget target;
  target.place = path;
  const fs::file_status status = fs::status(path, error);
  if (fs::is_directory(status)) fail_file(path, "is a directory; name a file");
  target.exists = fs::exists(status);
  target.regular = !target.exists || fs::is_regular_file(status);
  if (target.regular && fs::is_symlink(fs::symlink_status(path, error))) {
    target.place = fs::canonical(path, error);
    if (error) fail_file(path, "is a link to nothing: " + error.message() + "; remove it");
  }
  if (!target.exists) return target;
  // Renaming would get past the protection of a file, so look at it first.
  constexpr fs::perms any_write = fs::perms::owner_write | fs::perms::group_write | fs::perms::others_write;
  if (target.regular && (status.permissions() & any_write) == fs::perms::none) {
    fail_file(path, "is read-only; change its permissions or choose another name");
  }
  errno = 0;
  if (!may_write(target.place)) fail_file(path, "may not be written: " + system_message() + kNoPermission);
  target.other_names = target.regular && fs::hard_link_count(target.place, error) > 1 && !error;
  return target;
}

// What the file grows by goes first: only that needs room.
void overwrite_file(const std::filesystem::path& path, const std::filesystem::path& place, const std::string& content,
                    const Execution& run) {
  run.report(0);  // and not again: half of it must not be written
  const Execution unwatched;
  std::error_code error;
  const auto old_size = static_cast<std::size_t>(std::filesystem::file_size(place, error));
  if (error) fail_file(path, "cannot be looked at: " + error.message() + kNoPermission);
  const std::size_t kept = std::min(old_size, content.size());
  OutputFile output;
  errno = 0;
  output.file = open_output(place, true);
  if (output.file == nullptr) fail_file(path, "cannot be opened: " + system_message() + kNoPermission);
  const bool grown =
      std::fseek(output.file, 0, SEEK_END) == 0 && output.write(std::string_view(content).substr(kept), unwatched);
  if (!grown) {
    const std::string message = system_message();
    output.close();
    std::error_code ignored;
    std::filesystem::resize_file(place, old_size, ignored);
    fail_file(path, "cannot be written: " + message + kNoRoom);
  }
  bool written =
      std::fseek(output.file, 0, SEEK_SET) == 0 && output.write(std::string_view(content).substr(0, kept), unwatched);
  written = output.close() && written;
  if (!written) error = std::error_code(errno != 0 ? errno : EIO, std::generic_category());
  if (written && content.size() < old_size) std::filesystem::resize_file(place, content.size(), error);
  if (error) fail_file(path, "cannot be written, and part of it is lost: " + error.message() + "; check the device");
}

}  // namespace

void require_replaceable(const std::filesystem::path& path) {
  const OutputTarget target = look_at_target(path);
  if (!target.regular || target.other_names) return;
  std::filesystem::path directory = target.place.parent_path();
  if (directory.empty()) directory = ".";
  errno = 0;
  if (!may_write(directory)) {
    fail_file(path, "cannot be created: " + system_message() + "; check that its directory exists and can be written");
  }
}

void replace_file(const std::filesystem::path& path, const std::string& content, const Execution& run) {
  const OutputTarget target = look_at_target(path);
  OutputFile output;
  if (!target.regular) {
    errno = 0;
    output.file = open_output(target.place, false);
    if (output.file == nullptr) fail_file(path, "cannot be opened: " + system_message() + kNoPermission);
    if (!output.write(content, run) || !output.close()) fail_file(path, "cannot be written: " + system_message() + kNoRoom);
    return;
  }
  if (target.other_names) return overwrite_file(path, target.place, content, run);
  open_temporary(output, target.place, target.exists);
  if (target.exists && !give_owner_and_mode(output, target.place)) return overwrite_file(path, target.place, content, run);
  if (!output.write(content, run) || !output.close()) fail_file(path, "cannot be written: " + system_message() + kNoRoom);
  std::error_code error;
  std::filesystem::rename(output.temporary, target.place, error);
  if (error) fail_file(path, "cannot be replaced: " + error.message() + kNoPermission);
  output.temporary.clear();
}

}  // namespace detail
}  // namespace amps
