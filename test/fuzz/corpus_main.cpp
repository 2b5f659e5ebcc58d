// Runs fuzz targets: with libFuzzer the one that ACMP_FUZZ names; else all over the files of their folders, each of
// which was a seed or a finding once. Usage: acmp_fuzz_corpus FOLDER

#include <cstdio>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <string>

#include "fuzz/fuzz_input.h"

#ifdef ACMP_FUZZ
extern "C" int LLVMFuzzerTestOneInput(const uint8_t* data, size_t size) {
  static const acmp::fuzz::Target target = acmp::fuzz::Targets().at(ACMP_FUZZ);
  const acmp::fuzz::Bytes bytes({reinterpret_cast<const char*>(data), size});
  acmp::fuzz::MayRefuse([&] { target(bytes); });
  return 0;
}
#else
int main(int argc, char** argv) {
  for (const auto& [name, target] : acmp::fuzz::Targets()) {
    int files = 0;
    for (const auto& entry :
         std::filesystem::directory_iterator(std::filesystem::path(argc > 1 ? argv[1] : ".") / name)) {
      std::printf("%s\n", entry.path().c_str());
      std::fflush(stdout);  // the last line names the file that ended the program
      std::ifstream stream(entry.path(), std::ios::binary);
      const std::string content{std::istreambuf_iterator<char>(stream), std::istreambuf_iterator<char>()};
      acmp::fuzz::MayRefuse([&, run = target] { run(acmp::fuzz::Bytes(content)); });
      ++files;
    }
    if (files == 0) return 1;
  }
  return 0;
}
#endif
