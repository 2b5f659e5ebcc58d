#pragma once

#include <sys/resource.h>
#include <unistd.h>

#include <csignal>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <string>
#include <vector>

#include "support/error_text.h"

namespace acmp {

inline std::string Bytes(const std::vector<float>& values) {
  return std::string(reinterpret_cast<const char*>(values.data()), values.size() * sizeof(float));
}

/// Builds a binary file byte by byte.
class Binary {
 public:
  template <class T>
  Binary& Add(T value) {
    bytes_.append(reinterpret_cast<const char*>(&value), sizeof(T));
    return *this;
  }
  Binary& AddDoubles(const std::vector<double>& values) {
    for (double value : values) Add(value);
    return *this;
  }
  Binary& AddName(const std::string& name) {
    bytes_ += name + '\0';
    return *this;
  }
  const std::string& bytes() const { return bytes_; }

 private:
  std::string bytes_;
};

/// An empty folder of its own for each test, removed at the end.
class TestFolder : public ::testing::Test {
 protected:
  TestFolder() {
    std::string pattern = (std::filesystem::temp_directory_path() / "acmp_test_XXXXXX").string();
    if (!mkdtemp(pattern.data())) throw std::runtime_error("mkdtemp failed for " + pattern);
    folder_ = pattern;
  }
  ~TestFolder() override {
    std::error_code ignored;
    std::filesystem::remove_all(folder_, ignored);
  }

  const std::filesystem::path& folder() const { return folder_; }

  std::filesystem::path WriteText(const std::string& name, const std::string& content) const {
    std::filesystem::path path = folder_ / name;
    std::filesystem::create_directories(path.parent_path());
    std::ofstream(path, std::ios::binary) << content;
    return path;
  }
  static std::string ReadText(const std::filesystem::path& path) {
    std::ifstream stream(path, std::ios::binary);
    return {std::istreambuf_iterator<char>(stream), std::istreambuf_iterator<char>()};
  }
  /// A path that nobody can write to, root included: it lies below a regular file.
  std::filesystem::path Unwritable(const std::string& name) const { return WriteText("a_file", "x") / name; }

 private:
  std::filesystem::path folder_;
};

/// A limit on the size of files stands in for a full disk: writes fail in the middle.
class FileSizeLimit {
 public:
  explicit FileSizeLimit(rlim_t bytes) : previous_handler_(std::signal(SIGXFSZ, SIG_IGN)) {
    ::getrlimit(RLIMIT_FSIZE, &previous_);
    rlimit limit = previous_;
    limit.rlim_cur = bytes;
    ::setrlimit(RLIMIT_FSIZE, &limit);
  }
  ~FileSizeLimit() {
    ::setrlimit(RLIMIT_FSIZE, &previous_);
    std::signal(SIGXFSZ, previous_handler_);
  }

 private:
  rlimit previous_{};
  void (*previous_handler_)(int);
};

template <class E, class Function>
std::string MessageOf(const Function& function) {
  return ErrorOf<E>(function);
}

}  // namespace acmp
