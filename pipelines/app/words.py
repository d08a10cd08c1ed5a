"""All texts of the page in one catalogue: English, and German as second language."""

import os
import re
from collections.abc import Callable
from functools import cache

from pipelines.api.wording import in_fields
from pipelines.report.inputs import quantity_label

__all__ = [
    "LANGUAGES",
    "Say",
    "hint_of",
    "label_of",
    "on_page",
    "says",
    "translated",
    "users_language",
]

LANGUAGES = {"en": "English", "de": "Deutsch"}
"""Languages by code."""

Say = Callable[..., str]
"""Text of a key; values fill its gaps."""

_TEXTS: dict[str, tuple[str, str]] = {
    "code": ("en", "de"),
    "title": ("Impact vision", "Impact vision"),
    "open": ("Open", "Öffnen"),
    "clip": ("Clip", "Aufnahme"),
    "setup": ("Set up", "Einrichten"),
    "folder": ("Folder", "Ordner"),
    "why": ("Why", "Warum"),
    "export": ("Export", "Ausgeben"),
    "pages": ("Pages", "Seiten"),
    "language": ("Language", "Sprache"),
    "dark": ("Dark", "Dunkel"),
    "measuring": ("Measuring: {step}", "Messung: {step}"),
    "starting": ("starting", "Start"),
    "following ball and pendulum": ("following ball and pendulum", "Ball und Pendel verfolgen"),
    "calibrating": ("calibrating", "Kalibrieren"),
    "propagating uncertainty": ("propagating uncertainty", "Unsicherheit berechnen"),
    "facts": (
        "{width} × {height} px, {frames} frames, {rate}",
        "{width} × {height} px, {frames} Bilder, {rate}",
    ),
    "stage": (
        "Frame. Arrow keys step, Shift steps by ten, plus and minus zoom. Drag an outline to"
        " correct it.",
        "Bild. Pfeiltasten blättern, mit Umschalt um zehn, Plus und Minus vergrößern. Einen Umriss"
        " zum Korrigieren ziehen.",
    ),
    "timeline": ("Frame number", "Bildnummer"),
    "frame": ("frame", "Bild"),
    "back": ("Previous frame", "Voriges Bild"),
    "forward": ("Next frame", "Nächstes Bild"),
    "play": ("Play or pause", "Abspielen oder anhalten"),
    "larger": ("Zoom in", "Vergrößern"),
    "smaller": ("Zoom out", "Verkleinern"),
    "ball": ("ball", "Ball"),
    "pendulum": ("pendulum", "Pendel"),
    "contact": ("contact", "Kontakt"),
    "landing": ("landing", "Landung"),
    "begins": ("motion begins", "Bewegung beginnt"),
    "release": ("release", "Loslassen"),
    "bounce": ("bounce", "Aufprall"),
    "stop": ("stop", "Stillstand"),
    "ends": ("motion ends", "Bewegung endet"),
    "this_ball": ("This is the ball", "Das ist der Ball"),
    "this_mass": ("This is the pendulum", "Das ist das Pendel"),
    "ignore": ("Ignore this", "Das nicht"),
    "move_outline": ("Move the outline", "Umriss verschieben"),
    "pivot": ("Pivot", "Drehachse"),
    "axes": ("Axes", "Achsen"),
    "stick": ("Calibration stick", "Maßstab im Bild"),
    "stick_length": ("Its length", "Seine Länge"),
    "stick_needs_length": (
        "Type the length of the stick, such as 1 m ± 2 mm. It must be in the plane of motion.",
        "Die Länge eingeben, etwa 1 m ± 2 mm. Er muss in der Bewegungsebene sein.",
    ),
    "point_at": (
        "Click it in the frame, or move the cross with the arrow keys and press Enter. Esc ends.",
        "Im Bild anklicken, oder das Kreuz mit Pfeiltasten bewegen und Enter drücken. Esc beendet.",
    ),
    "show_found": ("Show all found objects", "Alle gefundenen Objekte zeigen"),
    "undo": ("Undo", "Rückgängig"),
    "redo": ("Redo", "Wiederholen"),
    "results": ("Results", "Ergebnisse"),
    "motion": ("Motion: {kind}, probability {p}", "Bewegung: {kind}, Wahrscheinlichkeit {p}"),
    "sound": ("no contradiction found", "kein Widerspruch gefunden"),
    "assumed": ("assumed: {why}", "angenommen: {why}"),
    "contradicted": ("contradicted by: {why}", "Widerspruch: {why}"),
    "missing": ("not measured: {why}", "nicht gemessen: {why}"),
    "made_of": ("What is this ± made of?", "Woraus besteht dieses ±?"),
    "more": ("All {count} quantities", "Alle {count} Größen"),
    "cure": ("Use {what}: {text}", "{what} einsetzen: {text}"),
    "messages": ("Messages", "Meldungen"),
    "inputs": ("Inputs", "Eingaben"),
    "fps": ("Capture rate", "Bildrate"),
    "ball_input": ("Ball or diameter", "Ball oder Durchmesser"),
    "wall_grid": ("Wall grid", "Wandraster"),
    "scale": ("Scale", "Maßstab"),
    "setup_input": ("Set-up file", "Einrichtungsdatei"),
    "kind": ("Kind of motion", "Bewegung"),
    "kind_found": ("as found", "wie gefunden"),
    "kind_strike": ("strike", "Stoß durch ein Pendel"),
    "kind_flight": ("flight", "Flug"),
    "kind_drop": ("drop", "Fall"),
    "kind_bounce": ("bounce", "Aufprall"),
    "kind_swing": ("swing", "Schwingung"),
    "kind_collision": ("collision of two balls", "Stoß zweier Bälle"),
    "kind_roll": ("roll", "Rollen"),
    "kind_slide": ("slide", "Gleiten"),
    "kind_circle": ("circle", "Kreisbewegung"),
    "kind_carried": ("carried motion", "geführte Bewegung"),
    "kind_none": ("none of the known", "keine bekannte"),
    "set_up_there": ("Fill in “{what}” on page Set up", "„{what}“ auf Seite Einrichten ausfüllen"),
    "inputs_note": (
        "Distances, the pendulum and the air are in the set-up file, which page Set up writes.",
        "Abstände, Pendel und Luft stehen in der Einrichtungsdatei der Seite Einrichten.",
    ),
    "measure": ("Measure", "Messen"),
    "as_command": ("The same as a command", "Dasselbe als Befehl"),
    "as_python": ("The same in Python", "Dasselbe in Python"),
    "copy": ("Copy", "Kopieren"),
    "copied": ("Copied", "Kopiert"),
    "marks": ("Corrections: {count}", "Korrekturen: {count}"),
    "reset": ("Remove all corrections", "Alle Korrekturen entfernen"),
    "no_numbers": (
        "Nothing is measured yet. What would help: {question}",
        "Noch ist nichts gemessen. Das würde helfen: {question}",
    ),
    "which_ball": (
        "which of the found objects is the ball? Choose “This is the ball” and click it.",
        "welches der gefundenen Objekte ist der Ball? „Das ist der Ball“ wählen und anklicken.",
    ),
    "graphs": ("Graphs", "Diagramme"),
    "graphs_note": (
        "A click goes to that frame. Dragging over a time selects a span and fits it. The wheel"
        " zooms, Ctrl and dragging moves.",
        "Ein Klick geht zu diesem Bild. Ziehen über der Zeit wählt einen Abschnitt und passt ihn"
        " an. Das Rad vergrößert, Strg und Ziehen verschiebt.",
    ),
    "fit_of": ("Fit", "Anpassung an"),
    "from_frame": ("From frame", "Von Bild"),
    "to_frame": ("To frame", "Bis Bild"),
    "shape": ("Curve", "Kurve"),
    "shape_line": ("line", "Gerade"),
    "shape_parabola": ("parabola", "Parabel"),
    "shape_sine": ("sine", "Sinus"),
    "fit": ("Fit the span", "Abschnitt anpassen"),
    "term_at_start": ("Value at the first point", "Wert am ersten Punkt"),
    "term_slope": ("Slope at the first point", "Steigung am ersten Punkt"),
    "term_curvature": ("Second derivative", "Zweite Ableitung"),
    "term_mean": ("Mean", "Mittelwert"),
    "term_amplitude": ("Amplitude", "Amplitude"),
    "term_period": ("Period", "Periode"),
    "fit_note": (
        "{count} points, which scatter by {scatter}. The ± is of that scatter alone; scale and rate"
        " come in addition.",
        "{count} Punkte mit einer Streuung von {scatter}. Das ± kommt aus dieser Streuung allein;"
        " Maßstab und Bildrate kommen hinzu.",
    ),
    "path": ("Path", "Bahn"),
    "position": ("Position", "Ort"),
    "speed": ("Speed", "Geschwindigkeit"),
    "gap": ("Gap between pendulum and ball", "Spalt zwischen Pendel und Ball"),
    "angle": ("Angle of the pendulum", "Winkel des Pendels"),
    "open_title": ("Open a clip", "Eine Aufnahme öffnen"),
    "drop": (
        "Drop a clip here, or choose it with +; several become a folder",
        "Aufnahme hierher ziehen, oder mit + wählen; mehrere werden ein Ordner",
    ),
    "drop_note": (
        "It stays on this computer: a dropped clip is copied to {folder}.",
        "Sie bleibt auf diesem Rechner: eine Kopie kommt nach {folder}.",
    ),
    "choose_folder": ("Open a folder", "Einen Ordner öffnen"),
    "left_out": (
        "Files that are no clips were left out.",
        "Dateien, die keine Aufnahmen sind, wurden ausgelassen.",
    ),
    "path_of": ("Path of a clip or folder", "Pfad einer Aufnahme oder eines Ordners"),
    "not_copied": ("The clip can't be copied: {why}.", "Die Kopie gelingt nicht: {why}."),
    "recent": ("Recent", "Zuletzt geöffnet"),
    "samples": ("Samples", "Beispiele"),
    "strike": ("Strike", "Stoß"),
    "drop_kind": ("Drop", "Fall"),
    "swing": ("Swing", "Schwingung"),
    "sample_strike": (
        "A pendulum strikes a basketball: contact, launch, landing, restitution.",
        "Ein Pendel stößt einen Basketball: Kontakt, Abflug, Landung, Stoßzahl.",
    ),
    "sample_drop": (
        "A ball falls: the acceleration of gravity.",
        "Ein Ball fällt: die Fallbeschleunigung.",
    ),
    "sample_swing": ("A pendulum swings: its period.", "Ein Pendel schwingt: seine Dauer."),
    "how_to_film": ("How to film", "So filmen"),
    "film_good": (
        "Camera on a tripod, square to the wall; the ball moves along the wall.",
        "Kamera auf Stativ, senkrecht zur Wand; der Ball bewegt sich die Wand entlang.",
    ),
    "film_bad": (
        "Not oblique, and not with a ball that comes nearer: both change the scale.",
        "Nicht schräg, und kein Ball, der näher kommt: beides ändert den Maßstab.",
    ),
    "export_of": ("Export of {name}", "Ausgabe von {name}"),
    "nothing_to_export": (
        "Nothing is measured yet: first measure the clip.",
        "Noch ist nichts gemessen: zuerst die Aufnahme messen.",
    ),
    "sheet": ("One A4 page", "Eine A4-Seite"),
    "sheet_note": (
        "Opens in a new window; print it or save it as PDF there.",
        "Öffnet ein neues Fenster; dort drucken oder als PDF speichern.",
    ),
    "export_note": ("Files are written to {folder}.", "Dateien kommen nach {folder}."),
    "export_report": ("Report", "Bericht"),
    "export_workbook": ("Workbook", "Arbeitsmappe"),
    "export_csv": ("Results as CSV", "Ergebnisse als CSV"),
    "export_json": ("Results as JSON", "Ergebnisse als JSON"),
    "export_tracks": ("Tracks", "Bahnen"),
    "export_tracker": ("Project for Tracker", "Projekt für Tracker"),
    "export_kinovea": ("Project for Kinovea", "Projekt für Kinovea"),
    "export_overlay": ("Video with outlines", "Film mit Umrissen"),
    "export_notebook": ("Notebook that repeats it", "Notebook, das es wiederholt"),
    "writing": ("Writing {name}", "{name} wird geschrieben"),
    "written": ("Written: {name}", "Geschrieben: {name}"),
    "campaign_of": ("Campaign {name}", "Messreihe {name}"),
    "progress": ("Measured clips", "Gemessene Aufnahmen"),
    "folder_counts": (
        "{done} measured, {failed} failed, {waiting} waiting",
        "{done} gemessen, {failed} misslungen, {waiting} warten",
    ),
    "folder_running": (
        "Measuring: {done} measured, {failed} failed, {running} under way, {waiting} waiting",
        "Messung: {done} gemessen, {failed} misslungen, {running} in Arbeit, {waiting} warten",
    ),
    "trials": ("Lab book (CSV or XLSX)", "Laborbuch (CSV oder XLSX)"),
    "paste": (
        "Lab book as a sheet: type, or paste from a spreadsheet",
        "Laborbuch als Tabelle: eintippen oder einfügen",
    ),
    "paste_here": (
        "Paste here; headings: clip, and ball, backswing or session of each",
        "Hier einfügen; Überschriften: clip, dazu ball, backswing oder session",
    ),
    "cells": ("Cells of the lab book, to be edited", "Zellen des Laborbuchs zum Bearbeiten"),
    "paste_use": ("Use as lab book", "Als Laborbuch verwenden"),
    "measure_all": ("Measure all", "Alle messen"),
    "cor_axis": ("COR", "Stoßzahl"),
    "cor_graph": ("Restitution against impact speed", "Stoßzahl über Stoßgeschwindigkeit"),
    "cor_note": ("A click on a point opens its clip.", "Ein Klick öffnet die Aufnahme."),
    "film_more": (
        "for ± {target} film at least {count} more near {speed} m/s (now ± {std} there).",
        "für ± {target} noch mindestens {count} bei {speed} m/s filmen (dort jetzt ± {std}).",
    ),
    "filmed_enough": (
        "the law is known to ± {std} or better over the speeds filmed.",
        "das Gesetz ist bei allen gefilmten Geschwindigkeiten auf ± {std} oder besser bekannt.",
    ),
    "counts": ("counts", "zählt"),
    "excluded": ("marked as bad", "als schlecht markiert"),
    "law": ("fitted law", "angepasstes Gesetz"),
    "show_all": ("all", "alle"),
    "show_unsure": ("uncertain or failed", "unsicher oder misslungen"),
    "show_bad": ("marked as bad", "als schlecht markiert"),
    "folder_note": (
        "If the wrong object was followed, click the ball in the picture: the clip is measured"
        " again. A trial marked as bad keeps its row and is excluded from the laws.",
        "Wurde das Falsche verfolgt, den Ball im Bild anklicken: die Aufnahme wird neu gemessen."
        " Ein schlechter Versuch behält seine Zeile und zählt nicht für die Gesetze.",
    ),
    "frame_of": ("Frame with outlines", "Bild mit Umrissen"),
    "state_waiting": ("waiting", "wartet"),
    "state_running": ("being measured", "wird gemessen"),
    "state_done": ("measured, without these numbers", "gemessen, ohne diese Zahlen"),
    "state_failed": ("failed", "misslungen"),
    "pointed": ("Ball selected at {at} px", "Ball gewählt bei {at} px"),
    "bad": ("Bad: {why}", "Schlecht: {why}"),
    "why_bad": ("Why this trial is bad", "Warum dieser Versuch schlecht ist"),
    "mark": ("Mark as bad", "Als schlecht markieren"),
    "unmark": ("Remove mark", "Markierung entfernen"),
    "gone": ("{name} is no longer there.", "{name} ist nicht mehr da."),
    "why_of": ("Why: {name}", "Warum: {name}"),
    "why_note": (
        "Compares the recording with the model of the set-up, and names the physics that is"
        " missing. It takes up to some minutes.",
        "Vergleicht die Aufnahme mit dem Modell der Einrichtung und nennt die Physik, die fehlt."
        " Es dauert bis zu einigen Minuten.",
    ),
    "why_alone": (
        "Compares the recording with gravity alone: free fall, or a bob on a light cord. It names"
        " what is missing, such as drag or friction.",
        "Vergleicht die Aufnahme mit der Schwerkraft allein: freier Fall, oder ein Pendel an einem"
        " leichten Faden. Es nennt, was fehlt, etwa Luftwiderstand oder Reibung.",
    ),
    "explain": ("Compare", "Vergleichen"),
    "explaining": ("Comparing recording and model", "Aufnahme und Modell werden verglichen"),
    "why_picture": (
        "Residuals before and after, and the missing force",
        "Abweichungen vorher und nachher, und die fehlende Kraft",
    ),
    "why_report": ("Report of the comparison", "Bericht über den Vergleich"),
    "why_report_note": (
        "Recording and models, residuals, formula, proof, what was tried, what to measure next.",
        "Aufnahme und Modelle, Abweichungen, Formel, Beweis, Versuchtes, was als Nächstes zu messen"
        " ist.",
    ),
    "setup_of": ("Set-up of {name}", "Einrichtung von {name}"),
    "opening_clip": ("Opening the clip, searching wall grid and ball", "Aufnahme wird geöffnet"),
    "computing": ("Computing the uncertainty", "Unsicherheit wird berechnet"),
    "searching_grid": ("Searching for the wall grid", "Wandraster wird gesucht"),
    "measuring_corners": ("Measuring between the corners", "Messung zwischen den Ecken"),
    "tracking_ball": ("Tracking the ball", "Ball wird verfolgt"),
    "card_rate": ("Capture rate", "Bildrate"),
    "card_wall": ("Wall grid", "Wandraster"),
    "card_ball": ("Ball and support", "Ball und Auflage"),
    "card_distances": ("Distances", "Abstände"),
    "card_pendulum": ("Pendulum", "Pendel"),
    "card_lens": ("Lens", "Objektiv"),
    "fine_grid": ("Distance of fine lines", "Abstand der feinen Linien"),
    "ball_and_mass": ("Ball, or diameter and mass", "Ball, oder Durchmesser und Masse"),
    "support": ("Height of the support", "Höhe der Auflage"),
    "camera_distance": ("Camera to wall", "Kamera zur Wand"),
    "ball_plane": ("Ball's plane to wall", "Ballebene zur Wand"),
    "pendulum_mass": ("Mass of all that swings", "Masse von allem, was schwingt"),
    "pendulum_length": ("Pivot to where it strikes", "Drehachse bis zum Treffpunkt"),
    "pendulum_com": ("Pivot to centre of mass", "Drehachse bis zum Schwerpunkt"),
    "pendulum_period": ("Period, for the inertia", "Schwingungsdauer, für das Trägheitsmoment"),
    "pendulum_inertia": ("Inertia about the pivot", "Trägheitsmoment um die Drehachse"),
    "lens_file": ("Lens file, or folder of pictures", "Objektivdatei, oder Ordner mit Bildern"),
    "rate_known": (
        "{fps} fps: free fall determines the scale in addition.",
        "{fps} fps: der freie Fall bestimmt zusätzlich den Maßstab.",
    ),
    "rate_assumed": (
        "Unknown: {fps} fps is assumed. Every time and speed scales with it, and gravity can't be"
        " used as a scale. Find it in the camera's menu or manual.",
        "Unbekannt: {fps} fps ist angenommen. Jede Zeit und Geschwindigkeit hängt davon ab. Sie"
        " steht im Menü oder in der Anleitung der Kamera.",
    ),
    "pitch_assumed": ("Squares of 50 mm are assumed.", "Quadrate von 50 mm sind angenommen."),
    "grid_found": (
        "Found automatically: {count} crossings, each ± {std} px.",
        "Selbst gefunden: {count} Kreuzungen, jede ± {std} px.",
    ),
    "grid_corners": (
        "Measured between your corners: {count} crossings, each ± {std} px.",
        "Zwischen den Ecken gemessen: {count} Kreuzungen, jede ± {std} px.",
    ),
    "grid_hand": (
        "No lines found: your {count} corners are the grid, each ± {std} px.",
        "Keine Linien gefunden: die {count} Ecken sind das Raster, jede ± {std} px.",
    ),
    "not_tracked": (
        "The ball is not tracked yet; its track determines rest, landing and size.",
        "Der Ball ist noch nicht verfolgt; seine Bahn bestimmt Ruhelage, Landung und Größe.",
    ),
    "tracked_to_landing": (
        "Tracked from rest to its lowest position, the landing.",
        "Von der Ruhelage bis zum tiefsten Ort, der Landung, verfolgt.",
    ),
    "tracked": ("Tracked; its landing is not seen.", "Verfolgt; die Landung ist nicht zu sehen."),
    "track_ball": ("Track the ball", "Ball verfolgen"),
    "distances_note": (
        "Both may stay empty: grid, ball and free fall determine them less precisely than a tape.",
        "Beide dürfen leer bleiben: Raster, Ball und Fall bestimmen sie ungenauer als ein Maßband.",
    ),
    "depth_from": (
        "Ball's plane to wall from {source} alone: {value}.",
        "Ballebene zur Wand allein aus {source}: {value}.",
    ),
    "pendulum_note": (
        "For restitution, impulse and energy. Time ten swings of less than 10° and give the period:"
        " the inertia follows.",
        "Für Stoßzahl, Kraftstoß und Energie. Zehn Schwingungen unter 10° stoppen und die Dauer"
        " angeben: das Trägheitsmoment folgt.",
    ),
    "lens_note": (
        "The wall grid determines the lens, too. A folder of pictures of the printed board helps"
        " where the camera is square to the wall.",
        "Auch das Wandraster bestimmt das Objektiv. Ein Ordner mit Bildern der gedruckten Tafel"
        " hilft, wenn die Kamera senkrecht zur Wand steht.",
    ),
    "focal": ("Focal length {value}.", "Brennweite {value}."),
    "by_hand": ("Set four corners by hand", "Vier Ecken von Hand setzen"),
    "across": ("Squares across", "Quadrate quer"),
    "up": ("Squares up", "Quadrate hoch"),
    "measure_corners": ("Measure between them", "Dazwischen messen"),
    "point_rest": ("Ball at rest", "Ball in Ruhe"),
    "point_landing": ("Landing", "Landung"),
    "point_origin": ("Origin of the wall", "Ursprung der Wand"),
    "landing_assumed": ("Landing (assumed)", "Landung (angenommen)"),
    "layer": ("Drawn over the frame", "Über dem Bild"),
    "layer_grid": ("grid lines", "Rasterlinien"),
    "layer_map": ("uncertainty map", "Karte der Unsicherheit"),
    "layer_none": ("nothing", "nichts"),
    "map_note": (
        "Standard uncertainty of positions on the ball's plane, relative to the ball at rest.",
        "Unsicherheit von Orten in der Ballebene, bezogen auf den ruhenden Ball.",
    ),
    "expected": ("Landing uncertainty to expect", "Zu erwartende Unsicherheit der Landung"),
    "expected_open": ("Unknown yet.", "Noch unbekannt."),
    "expected_at": (
        "at the landing, {distance} from rest (one standard uncertainty)",
        "an der Landung, {distance} von der Ruhelage (eine Standardunsicherheit)",
    ),
    "expected_assumed": (
        "at an assumed landing, {distance} from rest (one standard uncertainty)",
        "an einer angenommenen Landung, {distance} von der Ruhelage (eine Standardunsicherheit)",
    ),
    "ball_is_scale": (
        "There is no wall grid: the ball's diameter is the scale. The landing is then less certain;"
        " a stick on page Clip helps.",
        "Ohne Wandraster ist der Durchmesser des Balls der Maßstab. Die Landung ist unsicherer;"
        " ein Maßstab auf der Seite Aufnahme hilft.",
    ),
    "verify_length": ("Verify a known length", "Eine bekannte Länge prüfen"),
    "place_ends": ("Place its ends", "Ihre Enden setzen"),
    "known_length": ("Known length", "Bekannte Länge"),
    "plane": ("Plane", "Ebene"),
    "on_wall": ("on the wall", "an der Wand"),
    "on_ball_plane": ("on the ball's plane", "in der Ballebene"),
    "save": ("Save only", "Nur speichern"),
    "writes": ("Measure writes {name}.", "Messen schreibt {name}."),
    "replaces": ("Measure replaces {name}.", "Messen ersetzt {name}."),
    "closed": (
        "The page is closed. You can close this window.",
        "Die Seite ist beendet. Dieses Fenster kann geschlossen werden.",
    ),
    "close": ("Quit", "Beenden"),
    "not_saved": ("The corrections are not saved: {why}", "Nicht gespeichert: {why}"),
}

_GERMAN_LABELS = {
    "contact_frames": "Bilder mit Kontakt",
    "contact_time": "Kontaktzeit Δt",
    "contact_start": "Kontakt beginnt",
    "contact_end": "Kontakt endet",
    "pendulum_speed_before": "Pendelgeschwindigkeit davor",
    "pendulum_speed_after": "Pendelgeschwindigkeit danach",
    "ball_speed": "Ballgeschwindigkeit beim Ablösen",
    "launch_angle": "Abflugwinkel",
    "landing_distance": "Wurfweite, korrigiert",
    "landing_distance_on_wall": "Wurfweite, an der Wand abgelesen",
    "landing_time": "Zeit vom Kontakt bis zur Landung",
    "cor_speeds": "Stoßzahl aus den Geschwindigkeiten (Gl. 2)",
    "cor_launch": "Stoßzahl aus dem Abflug (Gl. 9–10)",
    "cor_range": "Stoßzahl aus der Wurfweite (Gl. 17)",
    "cor": "Stoßzahl, Mittel der Schätzungen",
    "external_impulse": "äußerer Kraftstoß auf den Ball",
    "energy_loss": "Energieverlust des Pendels (Gl. 18)",
    "backswing_angle": "Ausholwinkel",
    "ball_plane_offset": "Ballebene vor der Wand",
    "camera_distance": "Abstand Kamera–Wand",
    "fall_acceleration": "Fallbeschleunigung",
    "flight_speed": "Geschwindigkeit im ersten Bild des Flugs",
    "flight_angle": "Winkel im ersten Bild des Flugs",
    "swing_period": "Schwingungsdauer",
    "swing_damping": "Dämpfung der Schwingung",
    "cor_bounce": "Stoßzahl des ersten Aufpralls",
    "roll_acceleration": "Beschleunigung entlang der Bahn",
    "roll_speed": "Geschwindigkeit im ersten Bild des Rollens",
    "speed_before": "Geschwindigkeit davor, des ruhenden Balls",
    "speed_after": "Geschwindigkeit danach, des ruhenden Balls",
    "other_speed_before": "Geschwindigkeit davor, des anderen Balls",
    "other_speed_after": "Geschwindigkeit danach, des anderen Balls",
    "cor_collision": "Stoßzahl entlang der Verbindung der Mitten",
}

_MESSAGES = (
    (
        "No pendulum given: the one of Ryu et al. (6.0 kg, 1.579 kg m²) is assumed. COR,"
        " impulse and energy hold only for that pendulum. Set [pendulum] in the setup file.",
        "Kein Pendel angegeben: das von Ryu et al. (6,0 kg, 1,579 kg m²) ist angenommen."
        " Stoßzahl, Kraftstoß und Energie gelten nur für dieses. „Pendel“ auf der Seite"
        " Einrichten ausfüllen.",
    ),
    (
        "No support height given: 0.312 m (Ryu et al.) is assumed. Landing and its COR hold"
        " only for that height. Set [support] height in the setup file.",
        "Keine Höhe der Auflage angegeben: 0,312 m (Ryu et al.) ist angenommen. Landung und"
        " ihre Stoßzahl gelten nur für diese Höhe. „Höhe der Auflage“ auf der Seite"
        " Einrichten ausfüllen.",
    ),
    (
        "No grid pitch given: squares of {} mm (Ryu et al.) are assumed. Every length is"
        " proportional to it. Pass --wall-grid.",
        "Kein Wandraster angegeben: Quadrate von {} mm (Ryu et al.) sind angenommen. Jede"
        " Länge ist proportional dazu. --wall-grid ausfüllen.",
    ),
    (
        "The camera's frame rate is not known: the file declares {}. {} fps are assumed."
        " Times and speeds are given only if a free fall with a known scale determines the"
        " rate. Pass --fps RATE, or set capture_fps in the setup file.",
        "Die Bildrate der Kamera ist unbekannt: in der Datei steht {}. {} Bilder je Sekunde"
        " sind angenommen. Zeiten und Geschwindigkeiten gibt es nur, wenn ein freier Fall mit"
        " bekanntem Maßstab die Rate bestimmt. --fps ausfüllen.",
    ),
    ("no frame rate", "keine"),
    ("{} frames per second", "{} Bilder je Sekunde"),
    (
        "Two facts are missing: the camera's rate and one length. Pass both, for example {}"
        " Seen: {}.",
        "Zwei Angaben fehlen: die Bildrate der Kamera und eine Länge, etwa --fps 240 und"
        " --ball 220mm. Zu sehen: {1}.",
    ),
    (
        "the ball is {} px wide and it falls with {} per picture squared",
        "der Ball ist {} px breit und fällt mit {} je Bild im Quadrat",
    ),
    ("the ball is {} px wide", "der Ball ist {} px breit"),
    ("it falls with {} per picture squared", "er fällt mit {} je Bild im Quadrat"),
    (
        "the motion is a {} with a probability of only {} (alternatives: {}): {}",
        "die Bewegung ist nur mit der Wahrscheinlichkeit {1} „{0}“ (sonst: {2}): {3}",
    ),
    (
        "the motion is a {} with a probability of only {}: {}",
        "die Bewegung ist nur mit der Wahrscheinlichkeit {1} „{0}“: {2}",
    ),
    (
        "its quantities hold only if it is a {}. Show more of the motion, or point at the"
        " ball with another --ball-at.",
        "die Größen gelten nur, wenn sie „{}“ ist. Mehr von der Bewegung zeigen, oder den"
        " Ball mit --ball-at anderswo anklicken.",
    ),
    (
        "its quantities are not given, since they would more probably be wrong than right."
        " Show more of the motion, or point at the ball with another --ball-at; or state"
        " --kind {}.",
        "Größen fehlen, denn sie wären eher falsch als richtig. Mehr von der Bewegung zeigen,"
        " den Ball mit --ball-at anderswo anklicken, oder --kind wählen.",
    ),
    ("the wall gives no calibration: {}", "die Wand ergibt keine Kalibrierung: {}"),
    (
        "the wall is nearly square to the camera, so its image gives only distance and focal"
        " length together: measure the distance to the wall, or name a lens.toml in the setup"
        " file",
        "die Kamera steht fast senkrecht zur Wand, deren Bild nur Abstand und Brennweite"
        " zusammen ergibt: den Abstand zur Wand messen, oder eine Objektivdatei angeben",
    ),
    (
        "it falls nearly from rest, so its path has no angle at the first frame",
        "er fällt fast aus der Ruhe, so dass die Bahn im ersten Bild keinen Winkel hat",
    ),
    (
        "the capture rate is unknown and can't be estimated from free fall: give it with"
        " --fps RATE, or capture_fps in the setup file",
        "die Bildrate ist unbekannt und folgt aus keinem freien Fall: --fps ausfüllen",
    ),
    (
        "neither a wall grid nor the ball's size gives a scale ({})",
        "weder ein Wandraster noch die Größe des Balls ergibt einen Maßstab ({})",
    ),
    ("it could not be determined from this clip", "aus dieser Aufnahme nicht bestimmbar"),
    (
        "Likely cause: {} does not fit the rest ({}). With {} everything fits (χ² {} → {}): {}.",
        "Wahrscheinliche Ursache: {} passt nicht zum Rest ({}). Mit {} passt alles (χ² {} →"
        " {}): {}.",
    ),
    (
        "Likely cause: {} does not fit the rest ({})",
        "Wahrscheinliche Ursache: {} passt nicht zum Rest ({})",
    ),
    (
        "no ball found: nothing round moves before a still background. {}",
        "kein Ball gefunden: nichts Rundes bewegt sich vor ruhendem Hintergrund. Ist der Ball"
        " wenigstens 5 Bildpunkte breit, ihn mit --ball-at anklicken.",
    ),
    (
        "there is no file {}. {}",
        "es gibt keine Datei {}. Den Pfad einer Aufnahme oder eines Ordners eingeben, oder"
        " eine Aufnahme hierher ziehen.",
    ),
    (
        "no clip is named. {}",
        "keine Aufnahme genannt. Den Pfad eingeben, oder sie hierher ziehen.",
    ),
    (
        "{} points are too few for a {}. Select {} or more.",
        "{0} Punkte sind zu wenige: mindestens {2} wählen.",
    ),
    (
        "the points do not determine a {}. {}",
        "die Punkte bestimmen die Kurve nicht: einen längeren Abschnitt wählen.",
    ),
    ("gap / mm", "Spalt / mm"),
    ("speed / {}", "Geschwindigkeit / {}"),
    ("angle / °", "Winkel / °"),
    ("{} (down)", "{} (nach unten)"),
    ("gap", "Spalt"),
    ("ball", "Ball"),
    ("pendulum", "Pendel"),
    ("ball {}", "Ball {}"),
    ("pendulum {}", "Pendel {}"),
    ("before contact", "vor dem Kontakt"),
    ("after contact", "nach dem Kontakt"),
    ("fitted flight", "angepasster Flug"),
    ("swing before", "Schwingung davor"),
    ("swing after", "Schwingung danach"),
    ("strike", "Stoß"),
    ("flight", "Flug"),
    ("drop", "Fall"),
    ("bounce", "Aufprall"),
    ("swing", "Schwingung"),
    ("roll {}", "Rollen {}"),
    ("flight {}", "Flug {}"),
    ("drop {}", "Fall {}"),
    ("bounce {}", "Aufprall {}"),
    ("swing {}", "Schwingung {}"),
    ("noise of the tracks", "Rauschen der Bahnen"),
    ("capture rate", "Bildrate"),
    ("moment of release", "Zeitpunkt des Ablösens"),
    ("onset and release between frames", "Beginn und Ende zwischen den Bildern"),
    ("balance of rigid bodies", "Bilanz starrer Körper"),
    ("inertia of the pendulum", "Trägheitsmoment des Pendels"),
    ("length of the pendulum", "Länge des Pendels"),
    ("mass of the pendulum", "Masse des Pendels"),
    ("pivot to centre of mass", "Drehachse bis zum Schwerpunkt"),
    ("depth of the mass' visible side", "Tiefe der sichtbaren Seite der Masse"),
    ("zero of the pendulum's angle", "Nullpunkt des Pendelwinkels"),
    ("pivot of the pendulum in the picture", "Drehachse im Bild"),
    ("pendulum just after contact", "Pendel gleich nach dem Kontakt"),
    ("direction of a round bob's contact", "Richtung des Kontakts einer Kugel"),
    ("height of the support", "Höhe der Auflage"),
    ("mass of the ball", "Masse des Balls"),
    ("roll of the camera (no grid)", "Rollen der Kamera (ohne Raster)"),
    ("tilt of the camera (no grid)", "Neigung der Kamera (ohne Raster)"),
    ("scale of lengths", "Maßstab der Längen"),
    ("depth of the motion's plane", "Tiefe der Bewegungsebene"),
    ("drag of the air", "Luftwiderstand"),
    (
        "change of the acceleration along the line",
        "Änderung der Beschleunigung entlang der Bahn",
    ),
    ("contradiction between estimates", "Widerspruch zwischen Schätzungen"),
    ("grid lines", "Rasterlinien"),
    ("pitch of the grid", "Abstand der Rasterlinien"),
    ("lens not calibrated", "Objektiv nicht kalibriert"),
    ("lens calibration", "Kalibrierung des Objektivs"),
    ("measured camera distance", "gemessener Kameraabstand"),
    ("measured ball plane offset", "gemessener Abstand der Ballebene"),
    ("ball diameter", "Durchmesser des Balls"),
    ("free fall", "freier Fall"),
    ("assumed ball plane offset", "angenommener Abstand der Ballebene"),
    ("ball in the picture", "Ball im Bild"),
    ("contact time", "Kontaktzeit"),
    ("measured camera position, x", "gemessener Ort der Kamera, x"),
    ("measured camera position, y", "gemessener Ort der Kamera, y"),
    ("measured axis foot, x", "gemessener Fußpunkt der Achse, x"),
    ("measured axis foot, y", "gemessener Fußpunkt der Achse, y"),
    ("variation between trials", "Streuung der Versuche"),
    ("coefficient of restitution", "Stoßzahl"),
    ("launch angle", "Abflugwinkel"),
    ("back-swing", "Ausholwinkel"),
    ("distance", "Abstand"),
    ("effective mass", "wirksame Masse"),
    ("drag coefficient", "Widerstandsbeiwert"),
    ("air density", "Luftdichte"),
    ("gravity", "Schwerkraft"),
    ("support height", "Höhe der Auflage"),
    ("ball mass", "Masse des Balls"),
    ("ball tracked", "Ball verfolgt"),
    ("wall grid found", "Wandraster gefunden"),
)
"""Messages, sources of uncertainty and names in graphs in English and German, with {} for what
differs. What is not here stays English."""

_GERMAN_MESSAGES = dict(_MESSAGES)


_QUANTITY_HINTS = {
    "contact_frames": (
        "Frames in which ball and pendulum touch",
        "Bilder, in denen sich Ball und Pendel berühren",
    ),
    "contact_time": (
        "From first touch to release, also between frames",
        "Von der ersten Berührung bis zum Ablösen, auch zwischen den Bildern",
    ),
    "launch_angle": (
        "Of the ball's velocity at release, above the horizontal",
        "Der Ballgeschwindigkeit beim Ablösen, über der Waagrechten",
    ),
    "landing_distance": (
        "From the ball's rest to its landing, in the plane of its flight",
        "Von der Ruhelage des Balls bis zur Landung, in der Ebene des Flugs",
    ),
    "landing_distance_on_wall": (
        "As the grid behind the ball reads: too far, as the ball is nearer to the camera",
        "Wie am Raster hinter dem Ball abgelesen: zu weit, denn der Ball ist näher an der Kamera",
    ),
    "cor": (
        "Coefficient of restitution: speed of separation over speed of approach, 1 without loss",
        "Stoßzahl: Geschwindigkeit des Trennens durch die des Annäherns, 1 ohne Verlust",
    ),
    "external_impulse": (
        "Mass of the ball times its speed at release",
        "Masse des Balls mal Geschwindigkeit beim Ablösen",
    ),
    "energy_loss": (
        "Kinetic energy of the pendulum before the contact minus that after it",
        "Bewegungsenergie des Pendels vor dem Kontakt minus der danach",
    ),
    "backswing_angle": (
        "From the lowest point, where the pendulum is let go",
        "Vom tiefsten Punkt aus, wo das Pendel losgelassen wird",
    ),
    "fall_acceleration": (
        "Downwards; 9.81 m/s² where rate and scale are right",
        "Nach unten; 9,81 m/s², wenn Bildrate und Maßstab stimmen",
    ),
    "roll_acceleration": (
        "Along the line of motion, positive where it speeds up",
        "Entlang der Bahn, positiv, wenn es schneller wird",
    ),
    "swing_period": ("Time of one swing to and fro", "Dauer einer Schwingung hin und her"),
    "swing_damping": (
        "The amplitude falls as exp(−damping · t)",
        "Die Auslenkung nimmt ab wie exp(−Dämpfung · t)",
    ),
    "std": (
        "Standard uncertainty: in 2 of 3 cases the true value is within ±",
        "Standardunsicherheit: in 2 von 3 Fällen liegt der wahre Wert innerhalb von ±",
    ),
}
"""Explanations that are shown on hovering; an estimate of a quantity has that quantity's."""


def hint_of(name: str, say: Say) -> str:
    """Explanation of a quantity; empty if its label says it all."""
    plain = name.removesuffix("_px")
    known = _QUANTITY_HINTS.get(plain) or _QUANTITY_HINTS.get(plain.partition("_")[0])
    return "" if known is None else known[list(LANGUAGES).index(say("code"))]


def says(language: str) -> Say:
    """Function that gives the texts of a language.

    Parameters
    ----------
    language : str
        A key of `LANGUAGES`.
    """
    place = list(LANGUAGES).index(language)

    def say(key: str, **values: object) -> str:
        return _TEXTS[key][place].format(**values)

    return say


def label_of(name: str, say: Say) -> str:
    """Label of a quantity."""
    own = _GERMAN_LABELS.get(name.removesuffix("_px")) if say("code") == "de" else None
    return own or quantity_label(name)


@cache
def _patterns() -> list[tuple[re.Pattern[str], str]]:
    """Messages with something that differs, those with most text first."""
    found = sorted((one for one in _MESSAGES if "{}" in one[0]), key=lambda one: -len(one[0]))
    return [(re.compile(re.escape(key).replace(r"\{\}", "(.+?)")), text) for key, text in found]


def translated(text: str, say: Say) -> str:
    """A text of the measurement in the page's language, as far as the catalogue has it."""
    if say("code") == "en":
        return text
    if text in _GERMAN_MESSAGES:
        return _GERMAN_MESSAGES[text]
    for pattern, german in _patterns():
        if (found := pattern.fullmatch(text)) is not None:
            return german.format(*(translated(one, say) for one in found.groups()))
    return text


_FIELD_KEYS = {
    "fps": "fps",
    "ball": "ball_input",
    "wall-grid": "wall_grid",
    "scale": "scale",
    "setup": "setup_input",
    "ball-at": "this_ball",
    "mass-at": "this_mass",
    "pivot-at": "pivot",
    "landing-at": "point_landing",
    "axes": "axes",
    "kind": "kind",
    "support-height": "support",
    "camera-distance": "camera_distance",
    "ball-plane": "ball_plane",
}
"""Keys of the fields and buttons that are options of `vision measure`."""


_POINT = re.compile(r"” -?\d+(?:\.\d+)?,-?\d+(?:\.\d+)?(?:,(\d+))?")
"""A button with the pixel at which a command would point."""


_SET_UP = re.compile(r"Set \[(pendulum|support)\](?: height)? in the setup file")


def on_page(message: str, say: Say) -> str:
    """A message as a sentence, with fields and buttons in place of options."""
    labels = {option: say(key) for option, key in _FIELD_KEYS.items()}
    placed = in_fields(translated(message, say), labels)
    keys = {"pendulum": "card_pendulum", "support": "support"}
    placed = _SET_UP.sub(lambda one: say("set_up_there", what=say(keys[one[1]])), placed)
    placed = _POINT.sub(lambda found: f"” ({say('frame')} {found[1]})" if found[1] else "”", placed)
    return placed[:1].upper() + placed[1:]


def users_language() -> str:
    """Language of the user's system if there is a catalogue for it, else English."""
    for name in ("LC_ALL", "LC_MESSAGES", "LANG"):
        if text := os.environ.get(name):
            code = text[:2].lower()
            return code if code in LANGUAGES else "en"
    return "en"
