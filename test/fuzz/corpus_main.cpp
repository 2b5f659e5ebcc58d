// In place of libFuzzer: runs a fuzz target over the files of folders, each of which was a seed or a finding once.
// Usage: fuzz_corpus TARGET FOLDER...

#include <cstdio>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <string>

#include "fuzz/fuzz_input.h"

#ifdef ACMP_FUZZ  // libFuzzer has a program for each target, which this names
extern "C" int LLVMFuzzerTestOneInput(const uint8_t* data, size_t size) {
  static const acmp::fuzz::Target target = acmp::fuzz::Targets().at(ACMP_FUZZ);
  const acmp::fuzz::Bytes bytes({reinterpret_cast<const char*>(data), size});
  acmp::fuzz::MayRefuse([&] { target(bytes); });
  return 0;
}
#else
int main(int argc, char** argv) {
  const auto target = acmp::fuzz::Targets().find(argc > 1 ? argv[1] : "");
  if (target == acmp::fuzz::Targets().end()) {
    std::printf("targets:\n");
    for (const auto& [name, function] : acmp::fuzz::Targets()) std::printf("%s\n", name.c_str());
    return 2;
  }
  int files = 0;
  for (int i = 2; i < argc; ++i) {
    for (const auto& entry : std::filesystem::directory_iterator(argv[i])) {
      std::printf("%s\n", entry.path().c_str());
      std::fflush(stdout);  // the last line names the file that ended the program
      std::ifstream stream(entry.path(), std::ios::binary);
      const std::string content{std::istreambuf_iterator<char>(stream), std::istreambuf_iterator<char>()};
      acmp::fuzz::MayRefuse([&] { target->second(acmp::fuzz::Bytes(content)); });
      ++files;
    }
  }
  std::printf("%d inputs\n", files);
  return files > 0 ? 0 : 1;
}
#endif
