#pragma once

#include <clocale>
#include <cstdlib>
#include <filesystem>
#include <locale>
#include <string>

namespace acmp {

/// While it lives, the process's locales have a decimal comma and thousands with points: as a German desktop.
class DecimalComma {
 public:
  explicit DecimalComma(const std::filesystem::path& folder) : streams_(std::locale::global(German())) {
    std::filesystem::create_directories(folder);
    const std::string make = "localedef -i de_DE -f UTF-8 '" + (folder / "de_DE.UTF-8").string() + "' >/dev/null 2>&1";
    const int ignored = std::system(make.c_str());  // where there is no localedef the system may have the locale
    static_cast<void>(ignored);
    setenv("LOCPATH", folder.c_str(), 1);
    has_c_locale_ = std::setlocale(LC_ALL, "de_DE.UTF-8") != nullptr;
  }
  ~DecimalComma() {
    std::setlocale(LC_ALL, "C");
    unsetenv("LOCPATH");
    std::locale::global(streams_);
  }
  DecimalComma(const DecimalComma&) = delete;
  DecimalComma& operator=(const DecimalComma&) = delete;

  /// False where the system cannot make one: then only streams have the comma.
  bool has_c_locale() const { return has_c_locale_; }

 private:
  struct Punctuation : std::numpunct<char> {
    char do_decimal_point() const override { return ','; }
    char do_thousands_sep() const override { return '.'; }
    std::string do_grouping() const override { return "\3"; }
  };
  static std::locale German() { return std::locale(std::locale::classic(), new Punctuation); }

  const std::locale streams_;
  bool has_c_locale_ = false;
};

}  // namespace acmp
