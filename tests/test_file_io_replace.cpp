// Files that are replaced: their other names and owners, who may write them, and what killed writers leave.
#include "amps/mesh_io.h"

#include "kit/mesh_files.h"

#include "amps/shapes.h"

#include <doctest/doctest.h>

#ifdef __linux__
#include <fcntl.h>
#include <sys/file.h>
#include <sys/resource.h>
#include <sys/stat.h>
#include <sys/wait.h>
#include <unistd.h>

#include <csignal>
#endif

#include <fstream>
#include <string>

namespace amps_test {

TEST_CASE("files: any content is written as meshes are, and looked at before") {
  const Folder folder;
  const fs::path path = folder.path / "table.csv";
  const std::string content("a\0b\r\n", 5);
  amps::require_writable_file(path);
  CHECK(folder.entries() == 0);
  amps::write_file(path, content);
  CHECK(content_of(path) == content);
  amps::write_file(path, "");
  CHECK(content_of(path).empty());
  amps::require_writable_file(path);
  CHECK(error_text([&] { amps::require_writable_file(folder.path); }).find("is a directory") != std::string::npos);
  CHECK(error_text([&] { amps::require_writable_file(folder.path / "no" / "x"); }).find("directory") != std::string::npos);
  fs::permissions(path, fs::perms::owner_read);
  CHECK(error_text([&] { amps::require_writable_file(path); }).find("read-only") != std::string::npos);
  fs::permissions(path, fs::perms::owner_all);
  CHECK(folder.entries() == 1);
}

#ifdef __linux__
namespace {

struct stat status_of(const fs::path& path) {
  struct stat status = {};
  REQUIRE(::lstat(path.c_str(), &status) == 0);
  return status;
}

/// What a child process that calls `f` ends with: 1 if it returns true, 0 if false, 2 if it throws, 1000 + signal if killed.
template <class F>
int in_child(const F& f) {
  const pid_t child = ::fork();
  REQUIRE(child >= 0);
  if (child == 0) {
    try {
      ::_exit(f() ? 1 : 0);
    } catch (...) {
      ::_exit(2);
    }
  }
  int status = 0;
  REQUIRE(::waitpid(child, &status, 0) == child);
  return WIFEXITED(status) ? WEXITSTATUS(status) : 1000 + WTERMSIG(status);
}

/// Likewise, by a user who is nobody. Only root can be that.
template <class F>
int as_nobody(const F& f) {
  constexpr uid_t nobody = 65534;
  return in_child([&] { return ::setgid(nobody) == 0 && ::setuid(nobody) == 0 && f(); });
}

bool is_refused(const fs::path& path, const char* why) {
  try {
    amps::require_writable_file(path);
  } catch (const Error& error) {
    const std::string first = error.what();
    try {
      amps::write_file(path, "other");
    } catch (const Error& second) {
      return first == second.what() && first.find(why) != std::string::npos;
    }
  }
  return false;
}

/// SIGXFSZ ignored, files of at most so many bytes.
struct SmallFiles {
  rlimit old = {};
  void (*handler)(int);
  explicit SmallFiles(rlim_t bytes) : handler(std::signal(SIGXFSZ, SIG_IGN)) {
    REQUIRE(::getrlimit(RLIMIT_FSIZE, &old) == 0);
    const rlimit small = {bytes, old.rlim_max};
    REQUIRE(::setrlimit(RLIMIT_FSIZE, &small) == 0);
  }
  ~SmallFiles() {
    ::setrlimit(RLIMIT_FSIZE, &old);
    std::signal(SIGXFSZ, handler);
  }
};

}  // namespace

TEST_CASE("files: hard links stay, whether the file grows or shrinks, and where it cannot grow") {
  const Folder folder;
  const fs::path path = folder.path / "a.txt", other = folder.path / "b.txt";
  amps::write_file(path, "as it was");
  fs::create_hard_link(path, other);
  const auto inode = status_of(path).st_ino;
  for (const std::string& content : {std::string("short"), std::string(9000, 'x'), std::string(), std::string("more")}) {
    amps::write_file(path, content);
    CHECK(content_of(path) == content);
    CHECK(content_of(other) == content);
  }
  {
    const SmallFiles limit(5000);
    CHECK(error_text([&] { amps::write_file(path, std::string(9000, 'y')); }).find("cannot be written") != std::string::npos);
  }
  CHECK(content_of(other) == "more");
  bool cancelled = false;
  const amps::Execution stops(1, amps::Progress([&](const char*, double) { return !(cancelled = true); }));
  CHECK(error_of([&] { amps::write_file(path, std::string(9000, 'y'), stops); }) == ErrorCode::kCancelled);
  CHECK(content_of(other) == "more");
  CHECK(status_of(path).st_ino == inode);
  CHECK(folder.entries() == 2);
}

TEST_CASE("files: modes and owners stay; what others may not write, they do not replace") {
  const Folder folder;
  fs::permissions(folder.path, fs::perms::all);  // everybody may rename in it
  const fs::path path = folder.path / "a.txt";
  amps::write_file(path, "as it was");
  for (const mode_t mode : {0600u, 0664u, 04755u}) {
    REQUIRE(::chmod(path.c_str(), mode) == 0);
    amps::write_file(path, "new");
    CHECK((status_of(path).st_mode & 07777u) == mode);
  }
  if (::geteuid() != 0) {
    MESSAGE("skipped: only root has files of others");
    return;
  }
  REQUIRE(::chmod(path.c_str(), 0644) == 0);
  CHECK(as_nobody([&] { return is_refused(path, "may not be written"); }) == 1);
  CHECK(content_of(path) == "new");
  // A file of root that all may write, and one of nobody that root writes.
  REQUIRE(::chmod(path.c_str(), 0666) == 0);
  CHECK(as_nobody([&] {
          amps::write_file(path, "by nobody");
          return true;
        }) == 1);
  CHECK(content_of(path) == "by nobody");
  CHECK(status_of(path).st_uid == 0);
  REQUIRE(::chown(path.c_str(), 65534, 65534) == 0);
  amps::write_file(path, "by root");
  CHECK(content_of(path) == "by root");
  CHECK(status_of(path).st_uid == 65534);
  CHECK(status_of(path).st_gid == 65534);
  // A new file where nobody may make one.
  fs::permissions(folder.path, fs::perms::owner_all | fs::perms::others_exec);
  CHECK(as_nobody([&] { return is_refused(folder.path / "new.txt", "cannot be created"); }) == 1);
  CHECK(folder.entries() == 1);
}

TEST_CASE("files: what killed writers left is taken away, what others are writing is not") {
  const Folder folder;
  const auto temporary = [&](int i) { return folder.path / (".amps-" + std::to_string(i) + ".tmp"); };
  const fs::path path = folder.path / "a.ply";
  const Mesh mesh = amps::make_sphere(2000);
  const int killed = in_child([&] {
    amps::write_file(path, std::string(9000000, 'k'), amps::Execution(1, amps::Progress([](const char*, double fraction) {
                                                                        if (fraction > 0.3) std::raise(SIGKILL);
                                                                        return true;
                                                                      })));
    return true;
  });
  CHECK(killed == 1000 + SIGKILL);
  CHECK(fs::exists(temporary(0)));
  CHECK(folder.entries() == 1);
  amps::write_mesh(path, mesh);
  CHECK(folder.entries() == 1);
  std::ofstream(temporary(0)) << "half of a mesh";
  std::ofstream(temporary(7)) << "half of a mesh";
  std::ofstream(folder.path / ".amps-x.tmp") << "of the user";
  fs::create_symlink("a.ply", temporary(3));
  amps::write_mesh(path, mesh);
  CHECK(same_bits(amps::read_mesh(path), mesh));
  CHECK(!fs::exists(temporary(0)));
  CHECK(!fs::exists(temporary(7)));
  CHECK(fs::is_symlink(temporary(3)));
  CHECK(folder.entries() == 3);
  // While one is written others are, in the same folder.
  int written = 0;
  amps::write_file(folder.path / "b.txt", std::string(9000000, 'b'),
                   amps::Execution(1, amps::Progress([&](const char*, double) {
                                     CHECK((!fs::exists(folder.path / "b.txt") || written > 0));
                                     amps::write_file(folder.path / "c.txt", std::to_string(written++));
                                     return true;
                                   })));
  CHECK(written >= 2);
  CHECK(content_of(folder.path / "b.txt").size() == 9000000);
  CHECK(content_of(folder.path / "c.txt") == std::to_string(written - 1));
  // One that somebody holds locked.
  std::ofstream(temporary(1)) << "being written";
  const int held = ::open(temporary(1).c_str(), O_WRONLY);
  REQUIRE(::flock(held, LOCK_EX) == 0);
  amps::write_mesh(path, mesh);
  CHECK(fs::exists(temporary(1)));
  ::close(held);
  amps::write_mesh(path, mesh);
  CHECK(!fs::exists(temporary(1)));
  CHECK(folder.entries() == 5);
}
#endif

}  // namespace amps_test
