# What stands around a release on the system: units, rules, pages, the user, folders. Part of install.sh, which sets
# $root, $NAME, $LIB, $SHARE, $ETC, $STATE, $CURRENT, $COMMAND_LINK, $UNITS and $is_enabled.
# shellcheck shell=bash disable=SC2153,SC2154

# Where the files of a release go on the system, one "from to" each; both below $root.
system_files() {
    local share="/opt/$1/share/$NAME" pair file
    for pair in "systemd $LIB/systemd/system" "sysusers.d $LIB/sysusers.d" "tmpfiles.d $LIB/tmpfiles.d" \
        "udev $LIB/udev/rules.d" "man $SHARE/man/man1" "completions/bash $SHARE/bash-completion/completions" \
        "completions/zsh $SHARE/zsh/site-functions" "completions/fish $SHARE/fish/vendor_completions.d"; do
        for file in "$root$share/${pair% *}"/*; do
            [ ! -f "$file" ] || say "${file#"$root"} ${pair#* }/$(basename "$file")"
        done
    done
}

# Sets has_changed where a file is another one than before.
put_system_files() {
    local release=$1 before=${2:-} from_file to
    if [ -n "$before" ] && [ "$before" != "$release" ]; then
        # What the release before had and this one has not.
        while read -r to; do
            rm -f "$root$to"
            has_changed=1
        done < <(comm -23 <(system_files "$before" | cut -d' ' -f2 | sort) \
            <(system_files "$release" | cut -d' ' -f2 | sort))
    fi
    while read -r from_file to; do
        cmp -s "$root$from_file" "$root$to" && continue
        install -D -m 644 "$root$from_file" "$root$to"
        has_changed=1
    done < <(system_files "$release")
    mkdir -p "$root$(dirname "$COMMAND_LINK")"
    [ -z "$has_changed" ] || sync -f "$root$(dirname "$COMMAND_LINK")"
    [ "$(readlink "$root$COMMAND_LINK" || true)" = "$CURRENT/bin/$NAME" ] \
        || ln -sfn "$CURRENT/bin/$NAME" "$root$COMMAND_LINK"
}

# Whether a program runs that was started from a release. Processes come and go meanwhile: that cat misses one, or
# that nobody reads to the end, must not look like "no", for then the files of a relay at work would be removed.
is_in_use() {
    local LC_ALL=C commands # bytes: an argument of somebody else's need not be text
    commands=$(cat /proc/[0-9]*/cmdline 2>/dev/null | tr '\0' '\n') || true
    [[ $commands == *"$1/"* ]]
}

# The user, the folders, and what the system has to hear of. Each is there already the second time.
prepare_system() {
    local sysusers="$root$LIB/sysusers.d/$NAME.conf" tmpfiles="$root$LIB/tmpfiles.d/$NAME.conf"
    if [ -e "$sysusers" ] && has systemd-sysusers; then
        systemd-sysusers ${root:+--root="$root"} "$sysusers"
    elif ! grep -q "^$NAME:" "$root/etc/passwd"; then
        useradd ${root:+--root "$root"} --system --user-group --groups dialout --no-create-home \
            --home-dir "$STATE" --shell /usr/sbin/nologin "$NAME"
    fi
    if [ -e "$tmpfiles" ] && has systemd-tmpfiles; then
        systemd-tmpfiles ${root:+--root="$root"} --create "$tmpfiles" || say "systemd-tmpfiles did not do all of it"
    fi
    [ -d "$root$ETC" ] || install -d -m 755 "$root$ETC"
    [ -d "$root$ETC/tables" ] || install -d -m 755 "$root$ETC/tables"
    [ -d "$root$STATE" ] || make_state
    ! is_systemd_running || systemctl daemon-reload # also after an installation that was interrupted before this
    if [ -z "$has_changed" ]; then
        return
    elif is_systemd_running; then
        ! has udevadm || { udevadm control --reload && udevadm trigger --subsystem-match=tty --action=change; } \
            || say "udev did not take the rules: it will with the next start of the machine"
    else
        say "systemd does not run here: units and udev rules count from the next start of the machine"
    fi
}

make_state() {
    local owner
    owner=$(awk -F: -v name="$NAME" '$1 == name { print $3 ":" $4 }' "$root/etc/passwd")
    install -d -m 700 -o "${owner%:*}" -g "${owner#*:}" "$root$STATE"
}

# Folders that install made below /usr/local, where nobody else put anything.
remove_empty_folders() {
    local pair
    for pair in "$LIB systemd/system" "$LIB sysusers.d" "$LIB tmpfiles.d" "$LIB udev/rules.d" "$SHARE/man man1" \
        "$SHARE bash-completion/completions" "$SHARE zsh/site-functions" "$SHARE fish/vendor_completions.d"; do
        (cd "$root${pair% *}" && rmdir -p --ignore-fail-on-non-empty "${pair#* }") 2>/dev/null || true
    done
}

say_what_runs() {
    is_systemd_running || return 0
    local unit
    for unit in "${UNITS[@]:1}"; do
        ! systemctl is-active --quiet "$unit" 2>/dev/null \
            || say "$unit runs as before: at standstill of the machine, systemctl restart $unit"
    done
}

enable_units() {
    [ -n "$is_enabled" ] || return 0
    if [ ! -e "$root$LIB/systemd/system/$NAME.target" ]; then
        die "this release has no $NAME.target to enable"
    elif has systemctl; then
        systemctl ${root:+--root="$root"} --quiet enable "${UNITS[@]}" && say "$NAME.target starts with the machine"
    else
        say "there is no systemctl here: nothing was enabled"
    fi
}

disable_units() {
    has systemctl || return 0
    if is_systemd_running; then
        systemctl stop "${UNITS[@]}" 2>/dev/null || true
    fi
    systemctl ${root:+--root="$root"} --quiet disable "${UNITS[@]}" 2>/dev/null || true
}
